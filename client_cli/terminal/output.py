"""What people and programs see: tables and one JSON document on stdout, everything on the way there on stderr."""

import json
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from api_schemas.visible import visible

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import Console

PIPE_COLUMNS = 10_000
"""Wide enough for any row."""


def stderr_console() -> "Console":
    """The console of progress and errors."""
    from rich.console import Console

    return Console(file=sys.stderr, highlight=False, soft_wrap=True, markup=False)


def print_document(document: "BaseModel | dict[str, object]") -> None:
    """The one JSON document of a command with ``--json``; flushed, since ``up`` goes on running after it."""
    body = document if isinstance(document, dict) else document.model_dump(mode="json")
    print_line(json.dumps(body, indent=2))


def print_line(text: str) -> None:
    """A line of the result, never cut or wrapped."""
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "the standard output") from error


def drop_stdout() -> None:
    """Have nothing more come of what stdout could not take; else Python would complain of it at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def note(text: str) -> None:
    """A line about the way to the result; lost where nobody takes it, which changes neither the result nor the exit code."""
    with suppress(OSError):
        sys.stderr.write(visible(text) + "\n")
        sys.stderr.flush()


def print_table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """A plain table whose last column takes the long texts; in a pipe or file each row is one line."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    *names, last = columns
    for name in names:
        table.add_column(name, no_wrap=True)
    table.add_column(last, overflow="fold")
    for row in rows:
        table.add_row(*("-" if cell is None else visible(str(cell)) for cell in row))
    console = Console(file=sys.stdout, highlight=False, markup=False, width=None if sys.stdout.isatty() else PIPE_COLUMNS)
    with console.capture() as capture:
        console.print(table)
    print_line("\n".join(line.rstrip() for line in capture.get().splitlines()))


def age(at: str | None, now: datetime | None = None) -> str:
    """How long ago ``at`` (ISO 8601) was, in one unit, such as "12 s" or "3 h"."""
    if at is None:
        return "-"
    return duration((now or datetime.now(UTC)).timestamp() - datetime.fromisoformat(at).timestamp())


def duration(seconds: float) -> str:
    """A duration in one unit."""
    for limit, divisor, unit in ((120, 1, "s"), (7200, 60, "min"), (172_800, 3600, "h")):
        if seconds < limit:
            return f"{max(seconds, 0) / divisor:.0f} {unit}"
    return f"{seconds / 86_400:.0f} d"


def counted(number: int, noun: str) -> str:
    """A number of things, such as "1 log" or "3 logs"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
