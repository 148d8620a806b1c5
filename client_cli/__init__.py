"""The command line of trifarm: a stranger to services and robots that speaks only HTTP with the farm."""
