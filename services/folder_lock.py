"""Processes that serve an embedded farm hold its folder together, so that whoever looks through it knows that it runs."""

import errno
import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from services.errors import NotReady

LOCK = "serve.lock"


@contextmanager
def held(data: Path) -> Iterator[None]:
    """Hold the folder, with others that do; the lock goes with the process, however it ends.

    Raises:
        NotReady: the lock's file cannot be opened.
    """
    with _opened(data / LOCK) as lock:
        _locked(lock.fileno(), fcntl.LOCK_SH)  # waits for whoever looks at the very moment whether it is held
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
