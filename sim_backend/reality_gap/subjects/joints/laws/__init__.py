"""What effects do to k joints along a recorded motion: the model, its laws, and which numbers of it may be wrong."""
