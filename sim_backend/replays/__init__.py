"""Replays of logs: from the log itself, with the original policy, with the truth of the robot."""
