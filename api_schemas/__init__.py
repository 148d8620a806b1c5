"""Messages between the three programs: HTTP bodies, bus messages, frames to a policy process.

This package imports none of the others; every other package may import it.
"""
