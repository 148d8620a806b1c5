"""What the robot is: cited numbers, the compiled scene and its kinematics."""
