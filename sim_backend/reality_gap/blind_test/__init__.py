"""Blind tests: effects hidden in simulated robots, found or not by a tool whose thresholds were frozen before."""
