"""A robot's core: it stays on one, and takes turns there with the other robots of the machine.

A robot and its policy process answer each other 50 times a simulated second. When several robots do so on one core at the
same time they throw each other out of its caches, which costs a quarter of the farm's rate; one trial after the other on each
core costs nothing, and uploads of one robot overlap with the trial of the next.
"""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

TURN_WITHIN_S = 5.0
"""After so long a robot runs without its turn: the one that holds it may hang, and must not stop others."""
_LOOK_EVERY_S = 0.002


def stay_on_one_core(robot: str) -> int:
    """Keep this process, and the children it will start, on the core that belongs to the robot's number; returns it."""
    cores = sorted(os.sched_getaffinity(0))
    number = robot.rpartition("-")[2]
    core = cores[int(number) % len(cores)] if number.isdigit() else cores[0]
    os.sched_setaffinity(0, {core})
    return core


@contextmanager
def turn(folder: Path, core: int, *, stop_reason: Callable[[], str | None]) -> Iterator[None]:
    """Hold the core's turn; the kernel gives it back when the process ends, however it ends.

    Waiting ends early when there is a reason to stop, which the trial then finds itself.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"core-{core}.turn").open("w") as file:
        give_up_s = time.monotonic() + TURN_WITHIN_S
        while time.monotonic() < give_up_s and stop_reason() is None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(_LOOK_EVERY_S)
        yield
