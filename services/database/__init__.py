"""The home of truth: tables, engines and migrations."""
