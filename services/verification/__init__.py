"""Verification of logs: a child process simulates a trial again and compares it with its truth."""
