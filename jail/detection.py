"""``python -m jail.detection``: enters a jail and tries to break out; prints the layers that held.

What a kernel announces and what it does are not always the same, so that a farm goes by this.
"""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from jail.entering import enter
from jail.environment import jail_environment
from jail.level import Jail, Layer
from jail.needs import Needs

MEMORY_BYTES = 1024**3
SAID_BYTES = 64 * 1024
WITHIN_S = 30.0


def detect() -> Jail:
    """The jail that children of this process get; without any layer if the trial breaks off."""
    command = [sys.executable, "-P", "-m", "jail.detection"]
    try:
        tried = subprocess.run(
            command, env=jail_environment(), cwd="/", stdin=subprocess.DEVNULL, capture_output=True, timeout=WITHIN_S, check=True
        )
        return Jail.of([Layer(name) for name in json.loads(tried.stdout)])
    except (OSError, subprocess.SubprocessError, ValueError):
        return Jail(())


def main() -> None:
    """Prints the layers that were closed and that no attempt got through."""
    closed = enter(Needs(MEMORY_BYTES, file_bytes=SAID_BYTES))
    print(json.dumps([layer for layer in closed.layers if not any(_succeeds(each) for each in _attempts(layer))]))


def _attempts(layer: Layer) -> tuple[Callable[[], object], ...]:
    """What each layer must make fail. Where one call is caught by two layers, either does."""
    return {
        Layer.LIMITS: (lambda: bytearray(2 * MEMORY_BYTES),),
        Layer.LANDLOCK_FILES: (lambda: Path("/").iterdir().__next__(), lambda: Path("/etc/passwd").read_bytes()),
        Layer.UNPRIVILEGED_USER: (lambda: os.setuid(0),),
        Layer.SYSTEM_CALLS: (socket.socket, lambda: socket.socket(socket.AF_UNIX), _fork, lambda: os.kill(os.getppid(), 0)),
    }.get(layer, ())


def _fork() -> None:
    if os.fork() == 0:
        os._exit(0)


def _succeeds(attempt: Callable[[], object]) -> bool:
    try:
        attempt()
    except (OSError, MemoryError):
        return False
    return True


if __name__ == "__main__":
    main()
