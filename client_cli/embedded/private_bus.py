"""Where the bus of an embedded farm is: a socket in the file system that this user's processes alone can open."""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SOCKET = "bus.sock"
LONGEST = 100
"""Bytes of a path; the kernel takes 107 (unix(7)), and the router puts a lock file beside it."""
_PLAIN = re.compile(r"[A-Za-z0-9_./+@-]+")
"""What neither the addresses of zenoh nor lists of them read as something else."""


def endpoint(path: Path) -> str:
    """The address of a bus at this path."""
    return f"unixsock-stream/{path}"


@contextmanager
def private_bus(data: Path) -> Iterator[str]:
    """The address of a bus in the data folder or, where its path is too long or strange for one, in a folder made for it.

    The socket is made by the services, under a umask that lets nobody else in; a folder made here is closed to others, too.
    """
    path = data.absolute() / SOCKET
    if len(os.fsencode(path)) <= LONGEST and _PLAIN.fullmatch(str(path)):
        try:
            yield endpoint(path)
        finally:
            _remove(path)
        return
    with tempfile.TemporaryDirectory(prefix="trifarm-bus-", ignore_cleanup_errors=True) as folder:
        yield endpoint(Path(folder) / SOCKET)


def _remove(path: Path) -> None:
    for each in (path, path.with_name(f"{path.name}.lock")):
        with suppress(OSError):
            each.unlink(missing_ok=True)
