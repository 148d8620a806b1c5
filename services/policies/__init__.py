"""Uploaded policies: checked, converted in a child process, run on recorded observations, kept."""
