"""Histories: what every client, dispatcher and robot did, one JSON document a line, written before and after each act."""

import json
import os
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

SUFFIX = ".ndjson"


@dataclass(frozen=True)
class Line:
    """One thing that somebody did.

    ``at_s`` is the machine's monotonic clock, which all processes of one machine share and no jump of the wall's clock moves.
    """

    at_s: float
    who: str
    did: str
    more: dict[str, Any]


class Writes(Protocol):
    """Takes what was done."""

    def __call__(self, did: str, **more: Any) -> None:
        """Writes one line."""
        ...


class History:
    """One writer's file. A line is on its way to the disk in one write, so that a killed writer leaves whole lines."""

    def __init__(self, folder: Path, who: str) -> None:
        self._who, self._lock = who, threading.Lock()
        folder.mkdir(parents=True, exist_ok=True)
        self._file = os.open(folder / f"{who}{SUFFIX}", os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)

    def __call__(self, did: str, **more: Any) -> None:
        """Writes one line."""
        line = json.dumps({"at_s": time.monotonic(), "who": self._who, "did": did} | more) + "\n"
        with self._lock:
            os.write(self._file, line.encode())

    def close(self) -> None:
        """Closes the file."""
        os.close(self._file)


def read(folder: Path) -> tuple[Line, ...]:
    """All lines of a folder's histories in the order of time."""
    return tuple(sorted(_lines(sorted(folder.glob(f"*{SUFFIX}"))), key=lambda line: line.at_s))


def _lines(paths: Iterable[Path]) -> Iterator[Line]:
    for path in paths:
        for text in path.read_text().splitlines():
            said = json.loads(text)
            yield Line(said.pop("at_s"), said.pop("who"), said.pop("did"), said)
