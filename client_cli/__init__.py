"""The command line of trifarm: a stranger to services and robots, with HTTP between them."""
