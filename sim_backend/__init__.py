"""The simulated TriFinger: robot, effects, driver, tasks, learning and the reality gap."""
