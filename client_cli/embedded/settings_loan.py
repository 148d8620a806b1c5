"""The settings file while a second farm runs: it names that one, and again the former when the second has ended."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import Connection, server_of, settings_file
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.output import note


@dataclass(frozen=True)
class FormerEntry:
    """What the settings file held before a farm wrote it, the address in it, and whether a farm answered there."""

    content: bytes
    url: str
    answers: bool


def former_entry(home: Path) -> FormerEntry | None:
    """The entry as it is now; None if there is none that can be read."""
    try:
        content = settings_file(home).read_bytes()
        url = str(json.loads(content)["url"])
        server_of(url)
    except (OSError, ValueError, KeyError, TypeError, UsageProblem):
        return None
    with ApiClient(Connection(url, None)) as client:
        return FormerEntry(content, url, client.is_up())


@contextmanager
def put_back(former: FormerEntry | None, connection: Connection, settings: Path) -> Iterator[None]:
    """Gives the file back to the former farm at the end, unless a third has written it since.

    Args:
        former: from before the farm started.
        connection: to the farm that runs now.
        settings: the file, which names it by now.
    """
    if former is None or former.url == connection.url:
        yield
        return
    ours = settings.read_bytes()
    try:
        if former.answers:
            note(
                f"{settings} names this farm now, and no longer the one at {former.url}, which still answers; when this one "
                "ends, it names that again (a TRIFARM_HOME of its own for each keeps them apart)"
            )
        yield
    finally:
        if settings.is_file() and settings.read_bytes() == ours:
            temporary = settings.with_suffix(f".{os.getpid()}.tmp")
            temporary.touch(0o600)
            temporary.write_bytes(former.content)
            temporary.replace(settings)
