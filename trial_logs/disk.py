"""The disk: how much room it has, words that are lost, not fatal, where it has none, and files that a power cut leaves whole."""

import errno
import io
import os
import sys
from dataclasses import dataclass
from pathlib import Path

FULL = frozenset({errno.ENOSPC, errno.EDQUOT})
MB = 1e6
STDOUT, STDERR = 1, 2


@dataclass(frozen=True)
class Room:
    """What a file system has: bytes that this user may still write, and bytes in all."""

    free_bytes: int
    total_bytes: int


def room(path: Path) -> Room:
    """The room of the file system that ``path``, which must exist, is on."""
    found = os.statvfs(path)
    return Room(found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize)


def is_full(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, is that a disk or a user's share of it is full."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        error = error.__cause__ or error.__context__
    return False


def sync(path: Path) -> None:
    """Waits until the disk has a file's content, or a folder's names."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def put_in_place(fresh: Path, path: Path) -> None:
    """Gives a new file in the same folder its name, in place of what has it: after a power cut either one is there, whole."""
    sync(fresh)
    fresh.replace(path)
    sync(path.parent)


def mb(size_bytes: float) -> str:
    """A size as it is told to people."""
    return f"{size_bytes / MB:.3g} MB" if size_bytes < 10 * MB else f"{size_bytes / MB:.0f} MB"


class _Lenient(io.RawIOBase):
    """Writes to a descriptor what it takes, and drops the rest: a log on a full disk must not end whom it is about."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor

    def writable(self) -> bool:
        return True

    def write(self, data) -> int:
        rest = memoryview(data).cast("B")
        size = rest.nbytes
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            return size
        return size


def lose_words_rather_than_end() -> None:
    """From now on, standard output and error of this process drop what the disk or pipe behind them does not take."""
    sys.stdout = _words(STDOUT)
    sys.stderr = _words(STDERR)


def words_into(path: Path) -> io.TextIOWrapper:
    """A file that lines are added to, also by others; what does not fit on its disk is dropped.

    Raises:
        OSError: it cannot be opened.
    """
    return _words(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600))


def _words(descriptor: int) -> io.TextIOWrapper:
    buffered = io.BufferedWriter(_Lenient(descriptor))
    return io.TextIOWrapper(buffered, encoding="utf-8", errors="backslashreplace", line_buffering=True)
