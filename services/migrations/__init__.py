"""Migrations of the database's schema, one file per revision."""
