"""Built-in policies without weights: they grasp the cube with three fingers, carry it and turn it."""
