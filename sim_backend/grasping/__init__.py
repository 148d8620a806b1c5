"""A policy that needs no weights: grasps the cube with three fingers and carries it."""
