"""Brings a trial's files into a folder: resumes what was interrupted, checks the SHA-256, renames only what is right."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from client_cli.connection.api_client import ApiClient, StoredFile
from client_cli.terminal.errors import ClientError, ServerAway

TRIES = 3


@dataclass(frozen=True)
class Download:
    """A file that is in its place, and whether it had been there before."""

    path: Path
    size_bytes: int
    was_there: bool


class Stopped(ClientError):
    """Another download failed, or the user pressed Ctrl-C; what has come so far is kept for the next time."""


def log_name(ordinal: int) -> str:
    """The file name of a trial's log in a fetched folder."""
    return f"trial-{ordinal:03d}.mcap"


def truth_name(ordinal: int) -> str:
    """The file name of a trial's truth in a fetched folder."""
    return f"trial-{ordinal:03d}.truth.mcap"


def download(client: ApiClient, stored: StoredFile, path: Path, stop: Event) -> Download:
    """Bring a stored file to ``path``."""
    if path.is_file() and sha256_of(path) == stored.sha256:
        return Download(path, path.stat().st_size, was_there=True)
    part = path.with_name(path.name + ".part")
    for left in reversed(range(TRIES)):
        try:
            _receive(client, stored, part, stop)
        except ServerAway:
            if not left:
                raise
            continue
        if sha256_of(part) == stored.sha256:
            part.replace(path)
            return Download(path, path.stat().st_size, was_there=False)
        # Wrong bytes may come from a part that another job left behind, so the next try starts anew.
        part.unlink()
    raise ClientError(f"{path.name} came {TRIES} times with another SHA-256 than the server names")


def _receive(client: ApiClient, stored: StoredFile, part: Path, stop: Event) -> None:
    offset = part.stat().st_size if part.exists() else 0
    if stored.size_bytes is not None and offset >= stored.size_bytes:
        return
    with client.file(stored.path, offset) as (start, chunks), part.open("r+b" if offset else "wb") as file:
        file.seek(start)
        file.truncate()
        for chunk in chunks:
            if stop.is_set():
                raise Stopped(f"stopped while fetching {part.name}")
            file.write(chunk)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
