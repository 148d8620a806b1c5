"""How far fitted values usually lie from the truth where a robot differs everywhere: measured on such robots.

There each cause takes over what the laws of the others leave, which no noise tells: at a lowest joint, which carries next to
nothing, far more than at the two above it. So errors are those of a joint's place in its finger.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES, TURNS_OF_MOTORS

FILE = Path(__file__).with_name("value_errors.json")
TELLING = 0.5
"""Share of a parameter's scale: where values are usually off by more, no single one tells that an effect is there."""
COVERED = 0.9
"""Share of the calibrating robots' values whose intervals are to hold the truth, for each parameter by itself."""


@cache
def usual_error(key: str, where: str) -> float:
    """Half of a 90 % interval that is to be added to a value's own, in its unit.

    0 for what was never named on those robots: it takes over nothing. What was named elsewhere alone has the largest of there.

    Args:
        key: "effect.parameter".
        where: a joint or the platform.
    """
    by_place = json.loads(FILE.read_text())["errors"].get(key, {})
    return by_place.get(place_in_finger(where), max(by_place.values(), default=0.0))


def place_in_finger(where: str) -> str:
    """Of a joint what all fingers have at its place, such as "base_to_upper"; of anything else its name."""
    finger, _, place = where.partition("_")
    return place if place and finger.startswith("finger") else where


def is_telling(key: str, where: str) -> bool:
    """Whether a value can show by itself, where a robot differs everywhere, that its effect is there."""
    return key in NUMBERS and usual_error(key, where) <= TELLING * SCALES[key]


def deviation(key: str, value: float, truth: float) -> float:
    """How far a value lies from the truth, in its unit; turns of motors have no whole ones."""
    off = value - truth
    return float((off + np.pi) % (2.0 * np.pi) - np.pi) if key in TURNS_OF_MOTORS else off


def usual_errors(rows: Sequence[Mapping]) -> dict[str, dict[str, float]]:
    """By parameter and place, what must be added to the intervals of some values so that so many of them hold the truth.

    Args:
        rows: ``key``, ``where``, ``value``, ``truth`` and ``own``, half of the interval that the noise alone gives.
    """
    beyond: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        off = deviation(row["key"], row["value"], row["truth"])
        at = beyond.setdefault(row["key"], {}).setdefault(place_in_finger(row["where"]), [])
        at.append(float(np.sqrt(max(0.0, off**2 - row["own"] ** 2))))
    return {
        key: {place: _quantile(values) for place, values in sorted(by_place.items())} for key, by_place in sorted(beyond.items())
    }


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
