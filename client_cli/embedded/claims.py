"""What an embedded farm must have to itself: its data folder, its files and its ports."""

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from client_cli.terminal.errors import UsageProblem

PRIVATE = 0o077


def usable_port(host: str, port: int) -> int:
    """``port`` if a server can listen on it, or any free one for 0."""
    with socket.socket() as listener:
        # As the server does: a port that only has old connections in TIME_WAIT is free.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
        except OSError as error:
            raise UsageProblem(
                f"port {port} of {host} cannot be used ({error.strerror}): does another farm run? Choose another with "
                "--port P, or --port 0 for any free one"
            ) from error
        return listener.getsockname()[1]


@contextmanager
def private_files() -> Iterator[None]:
    """Whatever is made meanwhile, here and by children, is for this user alone: it holds tokens, policies and the truth."""
    before = os.umask(PRIVATE)
    try:
        yield
    finally:
        os.umask(before)


@contextmanager
def held_folder(data: Path) -> Iterator[None]:
    """Hold the data folder for this process; the lock goes with the process, however it ends."""
    with (data / "up.lock").open("a+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            holder = lock.read().strip() or "unknown"
            raise UsageProblem(
                f"a farm already runs on {data} (process {holder}); use it, stop it, or choose another --data"
            ) from None
        lock.truncate(0)
        lock.write(str(os.getpid()))
        lock.flush()
        yield
