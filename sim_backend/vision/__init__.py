"""Cameras that see: calibration, rendered images as a robot's cameras would take them, and trackers that work on pixels."""
