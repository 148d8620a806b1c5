"""Which robots a process runs: numbers from one on, or the first that no other process beside it has taken."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from robot_farm.settings import Settings

MOST_NUMBERS = 10_000


@contextmanager
def held_names(settings: Settings) -> Iterator[tuple[str, ...]]:
    """The names of this process's robots; those that it found free are its own until it ends, however it ends.

    Processes beside each other are those that share a data folder, be it in containers of their own. A robot
    keeps its number when its process is killed and another takes its place, and with it its physics.

    Raises:
        ValueError: so many are not free.
    """
    if settings.first is not None:
        yield settings.robot_names
        return
    settings.robots_folder.mkdir(parents=True, exist_ok=True)
    held: list[int] = []
    try:
        names = tuple(_free_names(settings.robots_folder, settings.robots, held))
        if len(names) < settings.robots:
            raise ValueError(f"only {len(names)} of {settings.robots} robots are free below robot-{MOST_NUMBERS}")
        yield names
    finally:
        for descriptor in held:
            os.close(descriptor)


def _free_names(folder: Path, count: int, held: list[int]) -> Iterator[str]:
    for number in range(MOST_NUMBERS):
        if len(held) == count:
            return
        descriptor = os.open(folder / f"robot-{number}.place", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held.append(descriptor)
            yield f"robot-{number}"
            continue
        os.close(descriptor)
