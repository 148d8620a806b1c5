"""The report of a study: sentences for the console and one page for a browser."""
