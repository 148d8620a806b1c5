"""What kind of machine measures: figures of one kind are compared with each other, and with no other's."""

import os
import re
from pathlib import Path


def cpu_model() -> str:
    """The processor's name as the kernel says it."""
    found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found.group(1).strip() if found else os.uname().machine


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def kind() -> str:
    """Processor and number of cores, as a file's name can have it."""
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\((r|tm)\)", "", cpu_model().lower())).strip("-") + f"-{cores()}-cores"
