"""Writes the measured runs of the servo pendulum as tables: ``python convert.py FOLDER_OF_JSON_FILES OUT``."""

import csv
import json
import sys
from pathlib import Path

COLUMNS = ("timestamp", "position", "goal_position", "torque_enable", "input_volts")


def main(source: Path, out: Path) -> None:
    """One table for each run, in a folder for each gain: its name is the run's."""
    files = sorted(source.glob("*.json"))
    if not files:
        sys.exit(f"there are no JSON files in {source}")
    for file in files:
        run = json.loads(file.read_text())
        folder = out / f"kp{run['kp']}"
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / f"{run['trajectory']}.csv").open("w", newline="") as table:
            rows = csv.writer(table)
            rows.writerow(("time", "position", "target", "on", "volts", "kp"))
            for entry in run["entries"]:
                rows.writerow((*(float(entry[name]) for name in COLUMNS), run["kp"]))
    print(f"{len(files)} runs: {out}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
