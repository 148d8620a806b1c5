"""``python -m services.upkeep backup|restore|doctor``: one JSON document on stdout, code 1 and ``{"error": …}`` if it failed."""

import argparse
import json
import os
import sqlite3
import sys
from pathlib import Path

from services.upkeep.backup import back_up, restore
from services.upkeep.doctor import look_through
from services.upkeep.folder import UpkeepError

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
    except sqlite3.Error as error:
        hint = f"'trifarm doctor --data {given.data}' says whether its database is whole"
        sys.stdout.write(json.dumps({"error": f"SQLite cannot do it: {error}; {hint}"}))
        return 1
    except (OSError, UpkeepError) as error:
        sys.stdout.write(json.dumps({"error": str(error)}))
        return 1
    sys.stdout.write(json.dumps(said))
    return 0


if __name__ == "__main__":
    sys.exit(main())
