"""Who works in a folder: one sitting at a time, so that no run has two writers."""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

_LOOK_EVERY_S = 0.05


class TakenError(Exception):
    """Another sitting works there; the message says which process."""


@contextmanager
def taken(
    folder: Path,
    what: str,
    instead: str,
    *,
    waits: Callable[[str], None] | None = None,
    patience_s: float = 0.0,
    lock: str = "lock",
) -> Iterator[None]:
    """Have a folder to ourselves; the lock goes with this process and those that it begins, however they end.

    They inherit it: a training that has lost its parent keeps another sitting from writing into its checkpoint.

    Args:
        folder: made if it is not there.
        what: is done there, for the message.
        instead: what else the user may do, for the message.
        waits: is told whom we wait for, as long as it takes; without it nobody is waited for.
        patience_s: before anything is said: who was killed takes a moment to go.
        lock: name of the file that is locked.

    Raises:
        TakenError: another has it, and nobody is waited for.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / lock).open("a+") as file:
        if not _locked(file, patience_s):
            file.seek(0)
            holder = f"process {file.read().strip() or 'unknown'}, or one that it began"
            if waits is None:
                raise TakenError(f"{what} is under way in {folder}: {holder}; wait for its end or stop it, or {instead}")
            waits(f"{what} is under way in {folder}: {holder}; waiting for its end")
            fcntl.flock(file, fcntl.LOCK_EX)
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        os.set_inheritable(file.fileno(), True)
        yield


def _locked(file: TextIO, patience_s: float) -> bool:
    give_up_s = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= give_up_s:
                return False
            time.sleep(_LOOK_EVERY_S)
        else:
            return True
