"""How long a machine stood still while something was measured, and how slow it is: bounds of times are as much wider."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

LOOK_EVERY_S = 0.02
STALL_S = 0.1
"""A thread that wants to go on every ``LOOK_EVERY_S`` and does so only after as long has been kept from it."""


BEGINS_WITHIN_S, BEGINS_WORTH = 0.03, 20.0
"""A process of Python begins so soon on a quiet machine. What ends in seconds does as much as so many of them, at the most."""


@dataclass
class Stalls:
    """``seconds`` in which this process would have run and did not, and by which what was measured takes longer here."""

    seconds: float = 0.0


@contextmanager
def stalls() -> Iterator[Stalls]:
    """Counts the stalls until its end, and sees how slow the machine is."""
    found, over, begins_s = Stalls(), threading.Event(), _begins_s()

    def look() -> None:
        last_s = time.monotonic()
        while not over.wait(LOOK_EVERY_S):
            now_s = time.monotonic()
            found.seconds += now_s - last_s if now_s - last_s > STALL_S else 0.0
            last_s = now_s
        found.seconds += max(0.0, time.monotonic() - last_s - STALL_S)

    looking = threading.Thread(target=look)
    looking.start()
    try:
        yield found
    finally:
        over.set()
        looking.join()
        found.seconds += BEGINS_WORTH * max(0.0, max(begins_s, _begins_s()) - BEGINS_WITHIN_S)


def _begins_s() -> float:
    """How long a process of Python takes that does nothing, in seconds."""
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-I", "-S", "-c", ""], check=True)
    return time.monotonic() - began_s


class SteadyClock:
    """Stands in for ``time`` where what is tested has a monotonic clock: one that stands still while the machine does."""

    def __init__(self) -> None:
        self._now_s = time.monotonic()
        self._over = threading.Event()

    def monotonic(self) -> float:
        """Seconds: all that pass while this process runs."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Waits at least so long."""
        time.sleep(seconds)

    def run(self) -> None:
        """Goes on until it is stopped."""
        last_s = time.monotonic()
        while not self._over.wait(0.25 * LOOK_EVERY_S):
            now_s = time.monotonic()
            self._now_s += min(now_s - last_s, STALL_S)
            last_s = now_s

    def stop(self) -> None:
        """Ends ``run``."""
        self._over.set()


@contextmanager
def steady_clock() -> Iterator[SteadyClock]:
    """A clock of that kind, which runs."""
    clock = SteadyClock()
    running = threading.Thread(target=clock.run)
    running.start()
    try:
        yield clock
    finally:
        clock.stop()
        running.join()
