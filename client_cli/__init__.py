"""The command line of trifarm, which speaks HTTP with services and imports neither them nor robots."""
