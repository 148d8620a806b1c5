"""Messages between the three programs: HTTP bodies, bus messages, frames to a policy process.

It imports no package but ``jail``; every other package may import it.
"""
