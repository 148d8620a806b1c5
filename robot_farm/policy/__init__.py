"""Policies that robots run: uploaded ones in a jailed process, and built-in ones."""
