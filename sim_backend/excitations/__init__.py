"""Commands that move a robot so that its physics shows."""
