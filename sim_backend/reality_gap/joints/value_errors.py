"""How far fitted values usually lie from the truth where a robot differs everywhere: measured on such robots.

There each cause takes over what the laws of the others leave, which no noise tells.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.joints.hypotheses import SCALES

FILE = Path(__file__).with_name("value_errors.json")
COVERED = 0.9
"""Share of the calibrating robots' values whose intervals are to hold the truth, for each parameter by itself."""


@cache
def usual_error(key: str) -> float:
    """Half of a 90 % interval that is to be added to a value's own, in its unit; key is "effect.parameter"."""
    kept = json.loads(FILE.read_text())
    return kept["errors"].get(key, kept["share_of_scale"] * SCALES[key])


def usual_errors(rows: Sequence[Mapping]) -> dict[str, float]:
    """By parameter, what must be added to the intervals of some values so that so many of them hold the truth.

    Args:
        rows: ``key``, ``value``, ``truth`` and ``own``, half of the interval that the noise alone gives.
    """
    beyond: dict[str, list[float]] = {}
    for row in rows:
        off = row["value"] - row["truth"]
        beyond.setdefault(row["key"], []).append(float(np.sqrt(max(0.0, off**2 - row["own"] ** 2))))
    return {key: _quantile(values) for key, values in sorted(beyond.items())}


def document(rows: Sequence[Mapping], seeds: Sequence[int]) -> dict:
    """The calibration file; what is too rare to be measured gets the usual share of its scale (:data:`SCALES`)."""
    errors = usual_errors(rows)
    return {
        "errors": errors,
        "values": {key: sum(row["key"] == key for row in rows) for key in errors},
        "share_of_scale": float(np.median([error / SCALES[key] for key, error in errors.items()])),
        "robots": len(seeds),
        "seeds": [min(seeds), max(seeds)],
    }


def _quantile(values: Sequence[float]) -> float:
    """What also the next value stays below with the wanted chance; the largest where there are too few to tell."""
    rank = int(np.ceil((len(values) + 1) * COVERED))
    return sorted(values)[min(rank, len(values)) - 1]
