"""The arena between trials: clearing it, cooling motors, self-tests."""
