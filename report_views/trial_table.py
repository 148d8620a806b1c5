"""The trials of a job as a table: one row a trial, flat, with units in the names of its columns."""

import csv
import io
from collections.abc import Iterable
from typing import Any

from api_schemas.trial import Measures, Trial

Cell = str | int | float | bool | None
MEASURED = tuple(Measures.model_fields)
COLUMNS = (
    *("job_id", "trial", "trial_id", "state", "task", "seed", "robot", "attempts"),
    *("outcome", "fault", "reason", "failure", "failure_sentence", "failure_at_s", "failure_finger"),
    *MEASURED,
    *("wall_s", "log_sha256", "log_bytes"),
)
FORMULAS = ("=", "+", "-", "@", "\t", "\r")
"""What a text begins with that spreadsheets take for a formula."""


def row(trial: Trial) -> dict[str, Cell]:
    """A trial by the names of the columns; None where nothing is known."""
    outcome = trial.outcome
    failure = None if outcome is None else outcome.failure
    measures = None if outcome is None else outcome.measures
    known: dict[str, Any] = {
        "job_id": trial.job_id,
        "trial": trial.ordinal,
        "trial_id": trial.trial_id,
        "state": trial.state.value,
        "task": trial.task,
        "seed": trial.seed,
        "robot": trial.robot,
        "attempts": len(trial.attempts),
        "log_sha256": trial.log_sha256,
        "log_bytes": trial.log_bytes,
    }
    if outcome is not None:
        known |= {"outcome": outcome.kind.value, "fault": outcome.fault.value, "reason": outcome.reason, "wall_s": outcome.wall_s}
    if failure is not None:
        known |= {"failure": failure.kind, "failure_sentence": failure.sentence}
        known |= {"failure_at_s": failure.at_s, "failure_finger": failure.finger}
    if measures is not None:
        known |= measures.model_dump(mode="json")
    return {name: known.get(name) for name in COLUMNS}


def as_csv(trials: Iterable[Trial], *, with_names: bool = True) -> str:
    """The table as CSV, ``with_names`` of its columns in the first line; no text in it is a formula to a spreadsheet."""
    written = io.StringIO()
    writer = csv.DictWriter(written, COLUMNS, lineterminator="\n")
    if with_names:
        writer.writeheader()
    for trial in trials:
        writer.writerow({name: _harmless(cell) for name, cell in row(trial).items()})
    return written.getvalue()


def _harmless(cell: Cell) -> Cell:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULAS) else cell
