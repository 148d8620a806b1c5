"""What the robot is not: named physical deviations from the nominal robot, one vocabulary for robots, training and the gap."""
