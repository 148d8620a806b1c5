"""A child process of the embedded farm: its command, its log file, and its end."""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from client_cli.terminal.errors import UsageProblem

ROOT = Path(__file__).resolve().parents[2]
"""Where our packages lie: the clone, or the installation."""
TAIL_LINES = 15
LOG_BYTES = 10 * 1024**2
LOGS_KEPT = 3
LOOK_EVERY_S = 0.01
IN_A_CLONE = "pyproject.toml"
"""Lies beside our packages in a clone only; a package called chaos may be anybody's in an environment's folder."""
OWN_PREFIX = "TRIFARM_"
"""No such variable of the caller reaches a child that is not given it: an embedded farm has its own tokens."""


def module_command(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of this installation; -P keeps a folder of the same name in the user's out of it."""
    return [sys.executable, "-P", "-m", module, *arguments]


def clone_command(module: str, *arguments: str) -> list[str]:
    """The command that runs a module which only a clone of the repository has.

    Raises:
        UsageProblem: trifarm was installed without the clone.
    """
    if not (ROOT / IN_A_CLONE).exists():
        raise UsageProblem(
            f"'{module}' is part of trifarm's repository, not of the installed package: clone the repository, run 'make setup' "
            "there, and use its .venv/bin/trifarm"
        )
    return module_command(module, *arguments)


def child_environment(**extra: str) -> dict[str, str]:
    """The environment of a child; it finds our packages in a clone that nobody has installed, too."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(OWN_PREFIX)} | extra
    if (ROOT / IN_A_CLONE).exists():
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (environment.get("PYTHONPATH"), str(ROOT))))
    return environment


@dataclass(frozen=True)
class ChildProcess:
    """A running child. ``log_start`` is where in the log file, which is kept over restarts, its own lines begin."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    log_start: int

    def has_ended(self) -> bool:
        """Whether the process is gone."""
        return self.process.poll() is not None

    def tail(self) -> str:
        """The last lines it wrote."""
        with self.log.open("rb") as file:
            file.seek(self.log_start if self.log.stat().st_size >= self.log_start else 0)  # it may have been rotated
            lines = file.read().decode(errors="replace").splitlines()
        return "\n".join(lines[-TAIL_LINES:])

    def rotate(self, limit_bytes: int = LOG_BYTES) -> None:
        """Put a log that has grown too large aside and begin it anew; of older ones ``LOGS_KEPT`` stay.

        The child goes on writing to the same file, always to its end: what it writes in the moment between copy and cut is lost.
        """
        if self.log.stat().st_size <= limit_bytes:
            return
        with suppress(OSError):  # on a full disk it is tried again, and what is lost then are words
            self._put_aside()

    def _put_aside(self) -> None:
        aside = [self.log.with_name(f"{self.log.name}.{number}") for number in range(1, LOGS_KEPT + 1)]
        for newer, older in reversed(list(itertools.pairwise(aside))):
            if newer.exists():
                newer.replace(older)
        shutil.copyfile(self.log, aside[0])
        os.truncate(self.log, 0)

    def ask_to_end(self) -> None:
        """Send SIGTERM."""
        with suppress(ProcessLookupError):
            self.process.terminate()

    def wait(self, timeout_s: float) -> None:
        """Wait for its end, but no longer than ``timeout_s``."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(max(timeout_s, 0.01))

    def kill(self) -> None:
        """Kill whatever is left of it and of its own children, which share its process group."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)

    def wait_for_all(self, timeout_s: float) -> None:
        """Wait until its own children have gone, too.

        Whoever is killed takes a moment to go, and its children are not ours to reap.
        """
        gives_up_s = time.monotonic() + timeout_s
        self.wait(timeout_s)
        with suppress(ProcessLookupError, PermissionError):
            while time.monotonic() < gives_up_s:
                os.killpg(self.process.pid, 0)
                time.sleep(LOOK_EVERY_S)


def start_child(name: str, command: list[str], environment: Mapping[str, str], log: Path) -> ChildProcess:
    """Start a child whose output goes to ``log``.

    It gets a session of its own, so that a Ctrl-C in the terminal reaches only us and we end the children in order.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as file:
        log_start = file.tell()
        process = subprocess.Popen(
            command, env=dict(environment), stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True
        )
    return ChildProcess(name=name, process=process, log=log, log_start=log_start)
