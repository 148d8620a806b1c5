"""How policies are trained here, and the reference policies that the project ships."""
