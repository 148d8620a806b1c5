"""``python -m tests.unit.jail.jail_escape SECRET``: a child with a folder tries what a conversion must not be able to do.

Prints a JSON object: for each attempt, the error that it met or null. ``SECRET`` is a file of the farm.
"""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

from jail.entering import enter
from jail.needs import Needs

GIB = 1024**3


def _met(attempt) -> str | None:
    try:
        attempt()
    except (OSError, MemoryError, ValueError) as error:
        return type(error).__name__
    return None


def _import_late() -> None:
    import xml.dom.minidom  # of the standard library, and not used before

    import scipy.linalg  # its libraries are loaded from inside the jail

    assert xml.dom.minidom, scipy.linalg


def main() -> None:
    secret = Path(sys.argv[1])
    folder = Path.cwd()
    jail = enter(Needs(4 * GIB, cpu_s=20, file_bytes=1000, installation=True, folder=folder))
    forbidden = {
        "/etc/passwd": lambda: Path("/etc/passwd").read_bytes(),
        "the farm's file": secret.read_bytes,
        "its folder": lambda: list(secret.parent.iterdir()),
        "outside": lambda: Path("/tmp/trifarm-escape").write_text("x"),
        "a library": lambda: Path(json.__file__).open("a").close(),
        "too large": lambda: Path("large").write_bytes(bytes(2000)),
        "a link out": lambda: (Path("link").symlink_to("/etc/passwd"), Path("link").read_bytes()),
        "socket": socket.socket,
        "unix socket": lambda: socket.socket(socket.AF_UNIX),
        "fork": os.fork,
        "program": lambda: subprocess.run(["/bin/true"], check=True),
        "memory": lambda: bytearray(8 * GIB),
        "kill": lambda: os.kill(os.getppid(), signal.SIGTERM),
        "owner of signals": lambda: __import__("fcntl").fcntl(0, __import__("fcntl").F_SETOWN, os.getppid()),
    }
    allowed = {
        "own file": lambda: Path("own").write_text("x"),
        "read it": lambda: Path("own").read_text(),
        "import": _import_late,
    }
    met = {name: _met(attempt) for name, attempt in (forbidden | allowed).items()}
    print(json.dumps({"jail": jail.level, "layers": jail.layers, "met": met, "allowed": list(allowed), "user": os.geteuid()}))


if __name__ == "__main__":
    main()
