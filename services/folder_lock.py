"""Processes that serve a farm hold its folder, so that whoever looks through it knows that it runs: on SQLite one at a time."""

import errno
import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from services.errors import NotReady

LOCK = "serve.lock"


PATIENCE_S = 10.0
"""For whoever looks at the very moment whether the folder is held, and for an orderly end, which takes 9 s at the most."""
_LOOK_EVERY_S = 0.05


@contextmanager
def held(data: Path, *, alone: bool) -> Iterator[None]:
    """Hold the folder; the lock goes with the process, however it ends.

    Args:
        data: the folder.
        alone: whether nobody else may hold it: two processes on one SQLite would migrate it and remove each other's files.

    Raises:
        NotReady: the lock's file cannot be opened, or another process holds the folder.
    """
    with _opened(data / LOCK) as lock:
        how, give_up_s = fcntl.LOCK_EX if alone else fcntl.LOCK_SH, time.monotonic() + PATIENCE_S
        while not _locked(lock.fileno(), how | fcntl.LOCK_NB):
            if time.monotonic() > give_up_s:
                hint = "stop it first, or give this one another folder (several serve one farm on PostgreSQL only: docs/scale.md)"
                raise NotReady(f"another process serves the farm in {data.absolute()}; {hint}")
            time.sleep(_LOOK_EVERY_S)
        yield


def is_held(path: Path) -> bool:
    """Whether a living process holds this lock."""
    try:
        with path.open("r") as lock:
            return not _locked(lock.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (FileNotFoundError, PermissionError):
        return False


def _opened(path: Path) -> TextIO:
    try:
        return path.open("a+")
    except OSError as error:
        raise NotReady(f"{path} cannot be opened: {error.strerror}") from error


def _locked(descriptor: int, how: int) -> bool:
    """Takes a lock if it is free, or there are none on this file system; it goes when the file is closed."""
    try:
        fcntl.flock(descriptor, how)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP):
            raise
    return True
