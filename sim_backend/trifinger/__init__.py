"""The nominal robot: cited numbers, the compiled scene and its kinematics."""
