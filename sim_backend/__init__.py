"""The simulated TriFinger: what the robot is, how one speaks to it, what is asked of it, and how it learns."""
