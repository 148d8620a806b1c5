"""The room that a robot keeps for its next trial: a file of that size, which gives way to the log as the log grows.

Blocks that are taken are seen by whoever else looks at the disk, so that robots on one disk need no word with each other, and
only as many of them are in service as have room to finish.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from trial_logs.disk import is_full, mb, room

TRIAL_BYTES = 16 << 20
"""A trial's log and truth, 6 MB together, and what the services on the same disk make of them, with some to spare."""
LEFT_BYTES = 8 << 20
"""What a robot leaves to services and words when it takes its reserve: what services keep for finishing."""
OF_LARGEST = 2.5
"""The reserve is at least so many times the largest trial that the robot has had."""
MOST_OF_DISK = 0.75
"""But for what a robot is told to keep, no reserve is a larger share of its disk: it would never come back."""
STEP_BYTES = 1 << 18
NAME = "reserve"


class Reserve:
    """One robot's reserve. Owner of its file; ``lacks`` says why the robot takes no offers, None while it has its reserve.

    Args:
        folder: the robot's, on the disk that its logs are written to.
        trial_bytes: how much a trial is expected to need; 0: no reserve is kept.
        left_bytes: how much must stay free beside it when it is taken.
        say: takes a line for the log, once when the room is gone and once when it is back.
    """

    def __init__(self, folder: Path, trial_bytes: int, say: Callable[[str], None], *, left_bytes: int = LEFT_BYTES) -> None:
        self._path, self._trial_bytes, self._left_bytes, self._say = folder / NAME, trial_bytes, left_bytes, say
        self._usual_bytes, self._kept_bytes = trial_bytes, 0
        self.lacks: str | None = None
        with suppress(OSError):
            self._path.unlink(missing_ok=True)  # of a process that was killed

    def take(self) -> None:
        """Have the whole reserve, or say what is lacking; to be called whenever no trial runs, again and again."""
        try:
            if self._kept_bytes >= self._trial_bytes and not self._is_short():
                return self._stands(None)
            found = room(self._path.parent)
        except OSError as error:
            self.shrink_to(0)
            return self._stands(f"its folder cannot be looked at: {error}")
        self._trial_bytes = min(self._trial_bytes, max(self._usual_bytes, int(MOST_OF_DISK * found.total_bytes)))
        if found.free_bytes + self._kept_bytes >= self._trial_bytes + self._left_bytes and self._grow():
            return self._stands(None)
        self.shrink_to(0)  # who cannot have all of it keeps nothing from others
        wanted = f"a trial needs {mb(self._trial_bytes)} and leaves {mb(self._left_bytes)} to others"
        return self._stands(f"the disk of its folder, of {mb(found.total_bytes)}, is full: {wanted}")

    def follow(self, *written: Path) -> None:
        """Give way to what a running trial has written so far."""
        size = sum(_size(each) for each in written)
        if OF_LARGEST * size > self._trial_bytes > 0:
            self._trial_bytes = int(OF_LARGEST * size)
        if self._kept_bytes > (left := max(0, self._trial_bytes - size)) + STEP_BYTES:
            self.shrink_to(left)

    def give_way(self, size_bytes: int) -> None:
        """Give up so much, for a file that is sent to services on the same disk."""
        self.shrink_to(max(0, self._kept_bytes - size_bytes))

    def shrink_to(self, size_bytes: int) -> None:
        """Keep no more than this."""
        if self._kept_bytes <= size_bytes:
            return
        with suppress(OSError):
            if size_bytes:
                os.truncate(self._path, size_bytes)
            else:
                self._path.unlink(missing_ok=True)
        self._kept_bytes = size_bytes

    def _is_short(self) -> bool:
        """Whether the robot, though it has its own, would take from others what they end by: its words and the database's."""
        return self._trial_bytes > 0 and room(self._path.parent).free_bytes < self._left_bytes

    def _grow(self) -> bool:
        try:
            with self._path.open("ab") as file:
                os.posix_fallocate(file.fileno(), 0, self._trial_bytes)
        except OSError as error:
            with suppress(OSError):  # some file systems keep what they had of it
                self._path.unlink(missing_ok=True)
            self._kept_bytes = 0
            if not is_full(error):
                self._say(f"keeps no reserve on the disk: {error}")  # a file system that knows no such thing
                self._trial_bytes = 0
            return not is_full(error)
        self._kept_bytes = self._trial_bytes
        return True

    def _stands(self, lacks: str | None) -> None:
        if (lacks is None) != (self.lacks is None):
            self._say("has room on its disk again" if lacks is None else f"takes no offers for now: {lacks}")
        self.lacks = lacks


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
