"""How far fitted values usually lie from the truth where a robot differs everywhere: measured on such robots.

There each cause takes over what the laws of the others leave, which no noise tells.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES

FILE = Path(__file__).with_name("value_errors.json")
TELLING = 0.5
"""Share of a parameter's scale: where values are usually off by more, no single one tells that an effect is there."""
COVERED = 0.9
"""Share of the calibrating robots' values whose intervals are to hold the truth, for each parameter by itself."""


@cache
def usual_error(key: str) -> float:
    """Half of a 90 % interval that is to be added to a value's own, in its unit; key is "effect.parameter".

    0 for what was never named on those robots: it takes over nothing.
    """
    return json.loads(FILE.read_text())["errors"].get(key, 0.0)


def is_telling(key: str) -> bool:
    """Whether a value can show by itself, where a robot differs everywhere, that its effect is there."""
    return key in NUMBERS and usual_error(key) <= TELLING * SCALES[key]


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
    """The calibration file."""
    errors = usual_errors(rows)
    return {
        "errors": errors,
        "values": {key: sum(row["key"] == key for row in rows) for key in errors},
        "robots": len(seeds),
        "seeds": [min(seeds), max(seeds)],
    }


def _quantile(values: Sequence[float]) -> float:
    """What also the next value stays below with the wanted chance; the largest where there are too few to tell."""
    rank = int(np.ceil((len(values) + 1) * COVERED))
    return sorted(values)[min(rank, len(values)) - 1]
