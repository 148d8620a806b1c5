"""Fault injection: starts a farm of its own, injects faults and checks the farm's promises. No other package imports it."""
