"""Training of policies, and the reference policies that the project ships."""
