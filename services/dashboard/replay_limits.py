"""How much the reduction of one log may take; known to the process that does it and to the one that reads what it made."""

LARGEST_REPLAY_BYTES = 16 * 1024**2
"""Many times what the longest trial becomes."""
MEMORY_BYTES = 512 * 1024**2
"""Of address space: three times what a trial's log takes."""
CPU_S = 30
DEADLINE_S = 60.0
