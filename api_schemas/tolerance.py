"""How near to its goal an object must end: what robots judge by, and what reports and pages say of it."""

import math

POSITION_TOLERANCE_M = 0.02
"""Of the middle of the object; success within 2 cm, as in the Real Robot Challenge 2022."""
ANGLE_TOLERANCE_RAD = math.radians(22.0)
"""Where the orientation counts."""
