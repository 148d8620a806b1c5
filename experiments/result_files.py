"""The JSON files of an experiment's results: written at once, and refused where they are of its other form."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.design import Experiment
from trial_logs.disk import put_in_place

RUNS, TRIALS, MEASURED = "runs", "trials", "measured"
"""Folders of results."""


class StoreError(Exception):
    """What lies there is none of this experiment; the message says what to do."""


@dataclass(frozen=True)
class Key:
    """One run of one cell on one kind of robots; ``physics`` is empty for a training."""

    cell: str
    seed: int
    physics: str = ""

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"{self.cell}-seed{self.seed}" + (f"-{self.physics}" if self.physics else "")


@dataclass(frozen=True)
class ResultFiles:
    """The files of one experiment in its folder of results."""

    folder: Path
    experiment: Experiment

    def read(self, path: Path) -> dict[str, Any] | None:
        """What a file holds; None if there is none.

        Raises:
            StoreError: it is a result of the quick form, and the full form is asked for, or the other way round.
        """
        if not path.exists():
            return None
        found = json.loads(path.read_text())
        if found["quick"] != self.experiment.quick:
            kind = "a quick form" if found["quick"] else "the full form"
            raise StoreError(f"{path} is a result of {kind}; quick and full results do not mix: give another --out")
        return found

    def write(self, path: Path, kind: str, document: Mapping[str, Any]) -> None:
        """Put a whole file in the place of what was there."""
        path.parent.mkdir(parents=True, exist_ok=True)
        whole = {"format": f"trifarm-experiment-{kind}/1", "quick": self.experiment.quick} | dict(document)
        fresh = path.with_suffix(".new")
        fresh.write_text(json.dumps(whole, indent=1) + "\n")
        put_in_place(fresh, path)
