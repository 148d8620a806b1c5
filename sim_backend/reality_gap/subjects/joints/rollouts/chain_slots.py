"""Where the arrays of a compiled chain of links keep what."""

ARMATURE, DAMPING, STIFFNESS, REST, OFFSET, LATE, OF_GAIN, OF_OWN, GAP, ROTOR, GIVE, CREEP = range(12)
"""Of a model's joints: numbers of the joint, its encoder, its controller's shares, its rotor with play, and its bearing."""
AHEAD, SPEED, SIDE, RUBS = range(4)
"""Of a rotor with play: by how much it is before its link, how fast it turns on its way across, the side on which it lies (1 or
-1; 0 on its way), and what friction it has there.
"""
UNKNOWN_SIDE = 2.0
"""At first: the first step shows where a rotor presses."""
TARGET, GAIN, BRAKE, LIMIT, BACK_EMF, DESIRED, ON_BOARD = range(7)
"""Of a recorded controller's law."""
