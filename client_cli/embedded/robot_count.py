"""How many robots this machine holds: two for each core, as far as its memory goes."""

import os
from pathlib import Path

MOST = 64
OF_A_CORE = 2
"""One runs while the other uploads its log and prepares the next trial; a third would wait."""
ROBOT_BYTES = 150 * 1024**2
"""What a robot and its policy process need besides what all robots share, with room for the arrays of a trial (decision 0024)."""
FARM_BYTES = 700 * 1024**2
"""Services, the process that robots come from, and the system's own room."""
MEMORY_FILES = Path("/proc/meminfo"), Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")


def fitting(cores: int, free_bytes: int | None) -> int:
    """Robots for so many cores, at least one; ``free_bytes`` of memory are theirs and the farm's, None where nobody knows."""
    by_memory = MOST if free_bytes is None else (free_bytes - FARM_BYTES) // ROBOT_BYTES
    return max(1, min(MOST, OF_A_CORE * cores, by_memory))


def of_this_machine() -> int:
    """Robots for the cores that this process may use, and for the memory that its machine and its group have left."""
    return fitting(len(os.sched_getaffinity(0)), free_memory_bytes(*MEMORY_FILES))


def free_memory_bytes(machine: Path, most: Path, used: Path) -> int | None:
    """What is free.

    Args:
        machine: as Linux says it of the machine, ``/proc/meminfo``.
        most: what the control group may use, "max" without a limit; it need not be there.
        used: what it uses.
    """
    found = []
    if machine.exists():
        found += [1024 * int(line.split()[1]) for line in machine.read_text().splitlines() if line.startswith("MemAvailable:")]
    if most.exists() and (limit := most.read_text().strip()).isdigit():
        found.append(int(limit) - int(used.read_text()))
    return min(found, default=None)
