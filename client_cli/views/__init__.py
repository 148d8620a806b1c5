"""Views of a job for people: progress while it runs, figures and print afterwards."""
