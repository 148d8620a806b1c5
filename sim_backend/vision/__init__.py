"""Cameras that see: calibration, and rendered images as a robot's cameras would take them."""
