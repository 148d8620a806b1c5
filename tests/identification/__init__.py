"""Effects are hidden in measured data, and must be found by name, place and value."""
