"""What a robot can be asked for at most, for those who judge a policy's actions without a simulation.

The numbers are those of ``sim_backend/trifinger/constants.py``; a test compares them.
"""

MAX_TORQUE_NM = 0.396
"""Of each motor, at its joint; the driver clips what is asked beyond it."""
SOFT_LIMIT_LOWER_RAD = (-0.33, 0.0, -2.7) * 3
SOFT_LIMIT_UPPER_RAD = (1.0, 1.57, 0.0) * 3
"""Where the driver turns each joint back, finger by finger."""
