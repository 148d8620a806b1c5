"""Writes the measured swings of the passive double pendulum as tables: ``python convert.py FILE.mat OUT`` (needs SciPy)."""

import csv
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat


def main(source: Path, out: Path) -> None:
    """A table for each swing: angles from hanging, the second one from the first arm, and no torque."""
    data = loadmat(source, squeeze_me=True)
    written = 0
    for name, folder in (("id", "swings"), ("vad", "validation")):
        (out / folder).mkdir(parents=True, exist_ok=True)
        for number, (time, y) in enumerate(zip(data[f"Time_{name}"], data[f"Y_{name}"], strict=True)):
            with (out / folder / f"swing-{number:02}.csv").open("w", newline="") as table:
                rows = csv.writer(table)
                rows.writerow(("time", "joint1", "joint2", "torque"))
                rows.writerows(zip(time, y[0] - np.pi, y[1] - y[0], np.zeros(len(time)), strict=True))
            written += 1
    print(f"{written} swings: {out}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
