"""Logs simulated again: by the log itself, by the original policy, by the truth of the robot."""
