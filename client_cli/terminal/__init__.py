"""Shared by commands at the terminal: options, output, errors, exit codes, child programs."""
