"""One process at a time serves an embedded farm from its folder: its queue has a single writer."""

import asyncio
import errno
import fcntl
import os
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TextIO

from services.errors import NotReady

LOCK = "serve.lock"
LOOK_EVERY_S = 0.1
ENDS_WITHIN_S = 5.0
"""A process that was told to end and has not yet."""


@asynccontextmanager
async def held_alone(data: Path) -> AsyncIterator[None]:
    """Hold the folder for this process; the lock goes with the process, however it ends.

    Raises:
        NotReady: another process holds it, and goes on doing so.
    """
    with _opened(data / LOCK) as lock:
        give_up_s = time.monotonic() + ENDS_WITHIN_S
        while not _locked(lock.fileno()):
            if time.monotonic() > give_up_s:
                lock.seek(0)
                holder = lock.read().strip() or "unknown"
                raise NotReady(
                    f"process {holder} serves a farm from {data}; stop it, or give this one another folder with --data"
                )
            await asyncio.sleep(LOOK_EVERY_S)
        with suppress(OSError):  # who holds it is a help, and a full disk no reason not to serve
            os.ftruncate(lock.fileno(), 0)
            os.write(lock.fileno(), str(os.getpid()).encode())
        yield


def _opened(path: Path) -> TextIO:
    try:
        return path.open("a+")
    except OSError as error:
        raise NotReady(f"{path} cannot be opened ({error.strerror}); it belongs to whoever served this folder before") from error


def is_held(path: Path) -> bool:
    """Whether a living process holds this lock."""
    try:
        with path.open("r") as lock:
            return not _locked(lock.fileno())
    except (FileNotFoundError, PermissionError):
        return False


def _locked(descriptor: int) -> bool:
    """Takes a lock if it is free, or there are none on this file system; it goes when the file is closed."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP):
            raise
    return True
