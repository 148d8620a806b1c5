"""A copy of an embedded farm's folder, made while the farm runs, and a farm made from such a copy."""

import json
import os
import shutil
import sqlite3
from collections import Counter
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from services.database.sqlite import integrity_check
from services.upkeep import folder as folders
from services.upkeep.folder import DATABASE, NEW_DATABASE, RECORD, Copy, UpkeepError
from trial_logs.disk import put_in_place


def back_up(data: Path, target: Path) -> dict[str, Any]:
    """Copies the farm in ``data`` to ``target``; a later one to the same folder copies what is new and mends what is damaged.

    The database is copied as it is at one moment; files are written before the rows that name them and never change, so
    that whatever the copy names is there. The record is replaced last: until then an earlier backup in the folder is whole,
    since its files stay and the new database waits under another name.

    Raises:
        UpkeepError: ``data`` is no farm's folder, its database or a file is damaged, or ``target`` lies in it or holds
            something else than a backup.
    """
    if target.exists() and any(target.iterdir()) and not (target / RECORD).exists():
        raise UpkeepError(f"{target} is not empty and no backup; name a new folder, or that of an earlier backup")
    with folders.opened(data / DATABASE) as farm:
        if target.resolve().is_relative_to(data.resolve()):
            raise UpkeepError(f"{target} lies in the farm's own folder {data} and would be lost with it; name a folder elsewhere")
        target.mkdir(parents=True, exist_ok=True, mode=0o700)
        if (earlier := folders.record_in(target)) is None:
            (target / RECORD).write_text(json.dumps({}))
        elif folders.database_of(target, earlier) == target / NEW_DATABASE:
            (target / NEW_DATABASE).replace(target / DATABASE)
        _copy_database(farm, data, target / NEW_DATABASE)
    with folders.opened(target / NEW_DATABASE) as copy:
        form, named = folders.form_of(copy), folders.references(copy)
    copies: Counter[Copy] = Counter()
    missing = 0
    for sha256 in sorted(named.needed | named.others):
        try:
            copies[folders.copy_object(folders.object_path(data, sha256), folders.object_path(target, sha256))] += 1
        except FileNotFoundError:
            missing += 1
    folders.copy_small(data, target)
    kept = [path.stat().st_size for path in folders.objects_in(target)]
    record = {
        "folder": str(target),
        "made_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": version("trifarm"),
        "form": form,
        "database_sha256": folders.sha256_of(target / NEW_DATABASE),
        "files": len(kept),
        "bytes": sum(kept),
        "copied": copies[Copy.NEW] + copies[Copy.MENDED],
        "mended": copies[Copy.MENDED],
        "missing": missing,
    }
    unfinished = target / "backup.new"
    unfinished.write_text(json.dumps(record, indent=2) + "\n")
    # What the record vouches for comes first: the files that were copied, and the database, of which a power cut leaves no half.
    os.sync()
    put_in_place(unfinished, target / RECORD)
    put_in_place(target / NEW_DATABASE, target / DATABASE)
    return record


def restore(backup: Path, data: Path) -> dict[str, Any]:
    """Makes the farm that a backup holds, in a folder that is empty or not there; every byte is checked on the way.

    Raises:
        UpkeepError: the backup is not whole or damaged, or ``data`` holds something.
    """
    record = folders.record_in(backup)
    if record is None:
        raise UpkeepError(f"{backup} is no whole backup: it has no {RECORD}; run 'trifarm backup' to its end, or name another")
    if data.exists() and any(data.iterdir()):
        raise UpkeepError(f"{data} is not empty; restore to a new folder, and start the farm there with --data")
    database = folders.database_of(backup, record)
    if database is None or integrity_check(database) != "ok":
        raise UpkeepError(f"{backup / DATABASE} is damaged; restore another backup")
    unfinished = data.with_name(f".{data.name}.restoring")
    shutil.rmtree(unfinished, ignore_errors=True)
    (unfinished / "files" / "incoming").mkdir(parents=True, mode=0o700)
    for path in folders.objects_in(backup):
        folders.copy_object(path, folders.object_path(unfinished, path.name))
    folders.copy_small(backup, unfinished)
    shutil.copyfile(database, unfinished / DATABASE)
    if data.exists():
        data.rmdir()
    unfinished.rename(data)
    with folders.opened(data / DATABASE) as farm:
        jobs, reports = (farm.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in ("job", "report"))  # noqa: S608
    return {"data": str(data), "made_at": record["made_at"], "form": record["form"], "jobs": jobs, "reports": reports}


def _copy_database(farm: sqlite3.Connection, data: Path, unfinished: Path) -> None:
    """Copies the database to a new file, and checks it there: damaged, it must not take the place of a good copy."""
    unfinished.unlink(missing_ok=True)
    try:
        with closing(sqlite3.connect(unfinished)) as copy:
            farm.backup(copy)
            # One file, that needs no other beside it.
            copy.execute("PRAGMA journal_mode = DELETE")
        verdict = integrity_check(unfinished)
    except sqlite3.OperationalError:  # of a database in use, or a full disk
        raise
    except sqlite3.DatabaseError as error:
        verdict = str(error)
    if verdict != "ok":
        unfinished.unlink(missing_ok=True)
        said = " ".join(verdict.split())[:200]
        hint = f"'trifarm doctor --data {data}' says what is wrong; an earlier backup in this folder is as it was"
        raise UpkeepError(f"{data / DATABASE} is damaged ({said}) and was not copied; {hint}")
