"""Blind tests of the reality gap: effects hidden in simulated robots, thresholds frozen before."""
