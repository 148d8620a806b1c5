"""``python -m services.upkeep backup|restore|doctor``: one JSON document on stdout, code 1 and ``{"error": …}`` if it failed."""

import argparse
import json
import os
import sqlite3
import sys
from pathlib import Path

from services.database.sqlite import is_full_sqlite
from services.upkeep.backup import back_up, restore
from services.upkeep.doctor import look_through
from services.upkeep.folder import UpkeepError
from trial_logs.disk import is_full

PRIVATE = 0o077


def main() -> int:
    """Runs one command; gives the exit code."""
    parser = argparse.ArgumentParser(prog="python -m services.upkeep")
    commands = parser.add_subparsers(dest="command", required=True)
    for name, other in (("backup", "--to"), ("restore", "--from")):
        command = commands.add_parser(name)
        command.add_argument("--data", type=Path, required=True)
        command.add_argument(other, dest="other", type=Path, required=True)
    doctor = commands.add_parser("doctor")
    doctor.add_argument("--data", type=Path, required=True)
    doctor.add_argument("--deep", action="store_true")
    given = parser.parse_args()
    os.umask(PRIVATE)
    try:
        match given.command:
            case "backup":
                said = back_up(given.data, given.other)
            case "restore":
                said = restore(given.other, given.data)
            case _:
                said = look_through(given.data, deep=given.deep)
    except (OSError, sqlite3.Error, UpkeepError) as error:
        sys.stdout.write(json.dumps({"error": _said(error, given)}))
        return 1
    sys.stdout.write(json.dumps(said))
    return 0


def _said(error: Exception, given: argparse.Namespace) -> str:
    """What is told of an error: of a full disk which one it is, of SQLite's what it was reading."""
    if is_full(error) or is_full_sqlite(error):
        return f"the disk of {given.other if given.command == 'backup' else given.data} is full; make room there and try again"
    if not isinstance(error, sqlite3.Error):
        return str(error)
    if given.command == "restore":
        return f"SQLite cannot do it: {error}; see that the backup {given.other} can be read, or restore another"
    return f"SQLite cannot do it: {error}; 'trifarm doctor --data {given.data}' says whether its database is whole"


if __name__ == "__main__":
    sys.exit(main())
