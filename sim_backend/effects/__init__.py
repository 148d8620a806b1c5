"""Effects: named physical deviations from the nominal robot, one vocabulary for robots, training and the reality gap."""
