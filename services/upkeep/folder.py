"""The data folder of an embedded farm as housekeeping sees it: its database, its files, and the small files that go with them."""

import hashlib
import json
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from services.signing import KEY_FILE

DATABASE = Path("farm.sqlite")
NEW_DATABASE = Path("farm.new")
"""In a backup: a database whose record is not yet there, or was written just before the backup was cut off."""
OBJECTS = Path("files") / "sha256"
SMALL = (Path("tokens.json"), Path("up.json"), Path(KEY_FILE), Path("robots") / "farm-secret")
"""What makes the restored farm the same: its tokens, the key it signs with, what its robots were told and are drawn from."""
PHYSICS = Path("physics")
UNFINISHED = ".new"
"""Ends the name of a file that is still being copied; one is left behind where a copy was cut off."""
RECORD = Path("backup.json")
_OF_REPORTS = "FROM trial JOIN job ON job.number = trial.job_number WHERE job.state != 'cancelled'"  # retention keeps no others
_REPORTED = f"SELECT trial.log_sha256 AS sha {_OF_REPORTS} UNION SELECT trial.truth_sha256 {_OF_REPORTS}"
_POLICIES = "SELECT weights_sha256 AS sha FROM policy UNION SELECT graph_sha256 FROM policy"
_ATTEMPTS = "SELECT log_sha256 AS sha FROM attempt UNION SELECT truth_sha256 FROM attempt"


class UpkeepError(Exception):
    """A folder cannot be copied, restored or looked through; the message says why and what to do next."""


@dataclass(frozen=True)
class References:
    """The files that a database names: those that policies and outcomes need, and those of other attempts, which may be gone."""

    needed: frozenset[str]
    others: frozenset[str]


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A database for reading.

    Raises:
        UpkeepError: there is none, or it cannot be read.
    """
    if not path.is_file():
        raise UpkeepError(
            f"there is no database {path}; name the farm's data folder with --data (a farm on PostgreSQL and S3 has its database "
            "there: docs/scale.md)"
        )
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        yield connection


def references(connection: sqlite3.Connection) -> References:
    """Which files the database names."""
    needed = _hashes(connection, f"{_POLICIES} UNION {_REPORTED}")
    return References(needed, _hashes(connection, _ATTEMPTS) - needed)


def form_of(connection: sqlite3.Connection) -> str:
    """The revision that the database is in."""
    return str(connection.execute("SELECT version_num FROM alembic_version").fetchone()[0])


def object_path(folder: Path, sha256: str) -> Path:
    """Where a data folder or a backup keeps a file."""
    return folder / OBJECTS / sha256[:2] / sha256


def objects_in(folder: Path) -> Iterator[Path]:
    """Every whole file that a data folder or a backup keeps."""
    return (path for path in (folder / OBJECTS).glob("*/*") if path.is_file() and path.suffix != UNFINISHED)


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Copy(StrEnum):
    """What became of a file that was to be copied."""

    KEPT = "kept"
    NEW = "new"
    MENDED = "mended"


def copy_object(source: Path, target: Path) -> Copy:
    """Copies a file under its name, which is its hash; what lies there already is read, too, and replaced where it is damaged.

    Raises:
        UpkeepError: the source does not hold what its name says.
    """
    size, was_there = source.stat().st_size, target.exists()
    if was_there and target.stat().st_size == size and sha256_of(target) == target.name:
        return Copy.KEPT
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_suffix(UNFINISHED)
    shutil.copyfile(source, unfinished)
    if (found := sha256_of(unfinished)) != source.name:
        unfinished.unlink()
        folder = source.parents[len(OBJECTS.parts) + 1]
        hint = f"'trifarm doctor --deep --data {folder}' lists all such files"
        raise UpkeepError(f"{source} is damaged: its content has the hash {found}; {hint}")
    unfinished.replace(target)
    return Copy.MENDED if was_there else Copy.NEW


def physics_files(folder: Path) -> tuple[Path, ...]:
    """The files of physics that robots of an embedded farm were told, from the folder on."""
    return tuple(sorted(each.relative_to(folder) for each in (folder / PHYSICS).glob("*")))


def copy_small(source: Path, target: Path) -> None:
    """Copies the small files that are there, for this user alone; each is replaced as a whole."""
    unfinished = target / f"small{UNFINISHED}"
    for name in (*SMALL, *physics_files(source)):
        if (source / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, unfinished)
            unfinished.chmod(0o600)
            unfinished.replace(target / name)


def record_in(folder: Path) -> dict[str, object] | None:
    """What a backup says of itself; None when the folder is no whole backup."""
    try:
        return json.loads((folder / RECORD).read_text()) or None
    except (FileNotFoundError, ValueError):
        return None


def database_of(backup: Path, record: dict[str, object]) -> Path | None:
    """The database that the record of a backup names by its hash; None when it is not there or damaged.

    A backup that was cut off right behind its record has it under the name of a new one.
    """
    there = (path for path in (backup / DATABASE, backup / NEW_DATABASE) if path.is_file())
    return next((path for path in there if sha256_of(path) == record["database_sha256"]), None)


def _hashes(connection: sqlite3.Connection, query: str) -> frozenset[str]:
    return frozenset(row[0] for row in connection.execute(query) if row[0] is not None)
