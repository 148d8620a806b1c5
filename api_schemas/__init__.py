"""What the three programs of trifarm say to each other: HTTP bodies, bus messages, log channels, policy frames.

This package imports none of the others; every other package may import it.
"""
