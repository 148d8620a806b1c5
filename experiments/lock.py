"""Who works in a folder: one sitting at a time, so that no run has two writers."""

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK = "lock"


class TakenError(Exception):
    """Another sitting works there; the message says which process."""


@contextmanager
def taken(folder: Path, what: str, *, waits: Callable[[str], None] | None = None) -> Iterator[None]:
    """Have a folder to ourselves; the lock goes with this process and its trainings, however they end.

    Trainings inherit it: one that has lost its parent keeps another sitting from writing into its checkpoint.

    Args:
        folder: made if it is not there.
        what: is done there, for the message.
        waits: is told whom we wait for; without it nobody is waited for.

    Raises:
        TakenError: another has it, and nobody is waited for.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = f"process {file.read().strip() or 'unknown'}, or a training that it began"
            if waits is None:
                raise TakenError(
                    f"{what} is under way in {folder}: {holder}; wait for its end or stop it, or give another --work and --out"
                ) from None
            waits(f"{what} is under way in {folder}: {holder}; waiting for its end")
            fcntl.flock(file, fcntl.LOCK_EX)
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        os.set_inheritable(file.fileno(), True)
        yield
