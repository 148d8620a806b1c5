"""The processes of a farm: started, killed, stopped, started again, and all ended at the end, whatever happened."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import structlog

from chaos.ending import end_with_parent

log = structlog.get_logger()
ROOT = Path(__file__).resolve().parents[1]
TAIL = 1500
"""Characters of a log that an error shows."""


class DidNotHappen(Exception):
    """What a run waited for did not come; the message says what and for how long."""


@dataclass
class Process:
    """One place of the farm, with or without a living process in it."""

    name: str
    command: Sequence[str]
    environment: Mapping[str, str]
    log: Path
    options: Mapping[str, object] = field(default_factory=dict)
    running: subprocess.Popen[bytes] | None = None
    killed: int = 0

    def start(self, **more: str) -> None:
        """Starts it; ``more`` is added to its environment."""
        self.log.parent.mkdir(parents=True, exist_ok=True)
        environment = {"PATH": os.environ.get("PATH", os.defpath), "PYTHONPATH": str(ROOT), "LC_ALL": "C.UTF-8"}
        with self.log.open("ab") as said:
            self.running = subprocess.Popen(  # pyrefly: ignore[no-matching-overload] - what else it takes is not said
                list(self.command),
                env=environment | dict(self.environment) | more,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                preexec_fn=end_with_parent,  # noqa: PLW1509  one thread starts all processes
                **self.options,
            )

    def is_alive(self) -> bool:
        """Whether there is a process, be it stopped."""
        return self.running is not None and self.running.poll() is None

    def send(self, number: signal.Signals) -> None:
        """Signals it; a process that has gone is none to signal."""
        if self.running is not None:
            with suppress(ProcessLookupError):
                self.running.send_signal(number)

    def kill(self) -> None:
        """Kill -9."""
        self.send(signal.SIGKILL)
        if self.running is not None:
            self.running.wait(10)
        self.killed += 1

    def cpu_s(self) -> float:
        """How much of a core it has taken; 0 where the system does not tell."""
        stat = Path(f"/proc/{0 if self.running is None else self.running.pid}/stat")
        if not stat.exists():
            return 0.0
        fields = stat.read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def said(self) -> str:
        """The end of what it wrote."""
        return self.log.read_text(errors="replace")[-TAIL:] if self.log.exists() else ""


@contextmanager
def process_group() -> Iterator[dict[str, Process]]:
    """Processes by name; those that live at the end are killed."""
    processes: dict[str, Process] = {}
    try:
        yield processes
    finally:
        for each in processes.values():
            each.send(signal.SIGKILL)
        for each in processes.values():
            if each.running is not None:
                with suppress(subprocess.TimeoutExpired):
                    each.running.wait(5)


def module(*arguments: str) -> list[str]:
    """The command that runs one of our programs."""
    return [sys.executable, "-P", "-m", *arguments]


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def until(happened: Callable[[], bool], within_s: float, what: str, every_s: float = 0.05) -> float:
    """Waits; gives how long that took, in seconds.

    Raises:
        DidNotHappen: not within ``within_s``.
    """
    began_s = time.monotonic()
    while not happened():
        if time.monotonic() - began_s > within_s:
            raise DidNotHappen(f"{what} did not happen within {within_s:g} s")
        time.sleep(every_s)
    return time.monotonic() - began_s
