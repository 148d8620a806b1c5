"""Measured data of other robots, read as their study.toml describes."""
