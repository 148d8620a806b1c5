"""Converts checkpoints of training libraries into policies, on the user's own machine, since reading one runs its code."""
