"""Looks through an embedded farm's folder and says what is wrong with it, if anything is."""

import hashlib
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from alembic.config import Config
from alembic.script import ScriptDirectory

from services.database.database import MIGRATIONS
from services.folder_lock import LOCK, is_held
from services.upkeep import folder as folders
from services.upkeep.folder import DATABASE, SMALL, UpkeepError, physics_files

LEAST_FREE_BYTES = 1024**3
NAMED = 3
PRIVATE = 0o077
Finding = dict[str, str]
Level = Literal["ok", "note", "problem"]


def look_through(data: Path, *, deep: bool) -> dict[str, Any]:
    """What is found in the folder; ``deep`` reads every file and compares it with its name.

    Raises:
        UpkeepError: there is no farm in it.
    """
    try:
        with folders.opened(data / DATABASE) as farm:
            findings = [*_database(farm), *_files(farm, data, deep=deep), *_jobs(farm, data), *_surroundings(data)]
    except sqlite3.DatabaseError as error:
        if "locked" in str(error):
            raise UpkeepError(f"{data / DATABASE} is in use and did not answer; try again") from error
        findings = [_found("problem", "database", f"it cannot be read ({error}); restore a backup")]
    return {"healthy": all(each["level"] != "problem" for each in findings), "data": str(data), "findings": findings}


def _found(level: Level, what: str, text: str) -> Finding:
    return {"level": level, "what": what, "text": text}


def _database(farm: sqlite3.Connection) -> Iterator[Finding]:
    verdict = farm.execute("PRAGMA integrity_check").fetchone()[0]
    broken = farm.execute("PRAGMA foreign_key_check").fetchall()
    if verdict != "ok" or broken:
        yield _found("problem", "database", f"it is damaged ({verdict}; {len(broken)} rows without owner); restore a backup")
    else:
        yield _found("ok", "database", "whole")
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    scripts, form = ScriptDirectory.from_config(config), folders.form_of(farm)
    newest = scripts.get_current_head()
    if form == newest:
        yield _found("ok", "form", f"{form}, the newest that this version knows")
    elif form in {script.revision for script in scripts.walk_revisions()}:
        yield _found("note", "form", f"{form}; this version brings it to {newest} when it starts")
    else:
        yield _found(
            "problem", "form", f"{form} was made by a newer version than this, which knows {newest}; start the newer one"
        )


def _files(farm: sqlite3.Connection, data: Path, *, deep: bool) -> Iterator[Finding]:
    named = folders.references(farm)
    there = {path.name: path for path in folders.objects_in(data)}
    if missing := sorted(named.needed - there.keys()):
        yield _found("problem", "files", f"{len(missing)} that policies or outcomes name are missing ({_some(missing)})")
    else:
        yield _found("ok", "files", f"all {len(named.needed)} that policies and outcomes name are there")
    damaged = sorted(name for name, path in there.items() if folders.sha256_of(path) != name) if deep else []
    if damaged:
        yield _found("problem", "content", f"{len(damaged)} files do not match their SHA-256 ({_some(damaged)})")
    elif deep:
        yield _found("ok", "content", f"all {len(there)} files match their SHA-256")
    loose = [path.stat().st_size for name, path in there.items() if name not in named.needed | named.others]
    if loose:
        yield _found(
            "note", "unused", f"{len(loose)} files of {sum(loose)} bytes belong to nothing; TRIFARM_KEEP_LOGS_DAYS removes such"
        )


def _jobs(farm: sqlite3.Connection, data: Path) -> Iterator[Finding]:
    without = "SELECT job_id FROM job WHERE state = 'succeeded' AND number NOT IN (SELECT job_number FROM report)"
    lost = [row[0] for row in farm.execute(without)]
    reports = farm.execute("SELECT body, sha256 FROM report").fetchall()
    changed = [sha256 for body, sha256 in reports if _sha(body) != sha256]
    if lost or changed:
        yield _found("problem", "reports", f"{len(lost)} are missing ({_some(lost)}), {len(changed)} were changed")
    else:
        yield _found("ok", "reports", f"all {len(reports)} are as they were written")
    unended = farm.execute("SELECT count(*) FROM job WHERE state IN ('queued', 'running')").fetchone()[0]
    runs = _is_running(data)
    if unended and not runs:
        yield _found(
            "note", "jobs", f"{unended} are not over and no farm runs here; 'trifarm up --data {data}' goes on with them"
        )
    yield _found("ok", "farm", "runs" if runs else "does not run")


def _surroundings(data: Path) -> Iterator[Finding]:
    free = shutil.disk_usage(data).free
    level: Level = "problem" if free < LEAST_FREE_BYTES else "ok"
    yield _found(level, "disk", f"{free / 1024**3:.1f} GiB are free; a farm needs at least {LEAST_FREE_BYTES / 1024**3:.0f}")
    private = (DATABASE, *SMALL, *physics_files(data))
    open_to_all = [str(name) for name in private if (data / name).exists() and (data / name).stat().st_mode & PRIVATE]
    if open_to_all:
        yield _found("problem", "privacy", f"others can read {', '.join(open_to_all)}; chmod 600 them")
    else:
        yield _found("ok", "privacy", "tokens and database are for this user alone")


def _is_running(data: Path) -> bool:
    """Whether ``trifarm up`` or ``python -m services serve`` holds the folder."""
    return any(is_held(data / name) for name in ("up.lock", LOCK))


def _sha(body: bytes | str) -> str:
    return hashlib.sha256(body if isinstance(body, bytes) else body.encode()).hexdigest()


def _some(names: list[str]) -> str:
    return ", ".join(names[:NAMED]) + (" and others" if len(names) > NAMED else "") if names else "none"
