"""Brings one trial's log into a folder: resumes what was interrupted, checks the SHA-256, renames only what is right."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from api_schemas.trial import Trial
from client_cli.api_client import ApiClient
from client_cli.errors import ClientError, ServerAway

TRIES = 3


@dataclass(frozen=True)
class Download:
    """A log that is in its place, and whether it had been there before."""

    path: Path
    size_bytes: int
    was_there: bool


class Stopped(ClientError):
    """Another download failed, or the user pressed Ctrl-C; what has come so far is kept for the next time."""


def log_name(ordinal: int) -> str:
    """The file name of a trial's log in a fetched folder."""
    return f"trial-{ordinal:03d}.mcap"


def download_log(client: ApiClient, trial: Trial, folder: Path, stop: Event) -> Download:
    """Bring the log of ``trial``, which must have one, to ``folder``."""
    path = folder / log_name(trial.ordinal)
    if path.is_file() and sha256_of(path) == trial.log_sha256:
        return Download(path, path.stat().st_size, was_there=True)
    part = path.with_name(path.name + ".part")
    for left in reversed(range(TRIES)):
        try:
            _receive(client, trial, part, stop)
        except ServerAway:
            if not left:
                raise
            continue
        if sha256_of(part) == trial.log_sha256:
            part.replace(path)
            return Download(path, path.stat().st_size, was_there=False)
        # Wrong bytes may come from a part that another job left behind, so the next try starts anew.
        part.unlink()
    raise ClientError(f"the log of trial {trial.trial_id} came {TRIES} times with another SHA-256 than the server names")


def _receive(client: ApiClient, trial: Trial, part: Path, stop: Event) -> None:
    offset = part.stat().st_size if part.exists() else 0
    if trial.log_bytes is not None and offset >= trial.log_bytes:
        return
    with client.log(trial.trial_id, offset) as (start, chunks), part.open("r+b" if offset else "wb") as file:
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
