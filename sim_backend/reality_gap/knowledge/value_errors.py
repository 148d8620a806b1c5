"""How far fitted values usually lie from the truth where a robot differs everywhere: measured on such robots.

There each cause takes over what the laws of the others leave, which no noise tells: at a lowest joint, which carries next to
nothing, far more than at the two above it, and often to one side, as motors that are warm seem to have less torque. So errors
are those of a joint's place in its finger, to either side. Friction near standstill whose speed is too small to be seen shows
in its product with that speed alone: its size is anything then, and other friction and the motor's torque make up for it.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES, TORQUE_CONSTANT, TURNS_OF_MOTORS
from sim_backend.reality_gap.quantiles import Z_90

FILE = Path(__file__).with_name("value_errors.json")
TELLING = 0.5
"""Share of a parameter's scale: where values are usually off by more, no single one tells that an effect is there."""
COVERED = 0.9
"""Share of the calibrating robots' values whose intervals are to hold the truth, for each parameter by itself."""


class UsualErrors(NamedTuple):
    """By how much the ends of a value's own 90 % interval usually fall short of the truth, below the value and above it."""

    below: float
    above: float

    @property
    def half(self) -> float:
        """Half of what both make."""
        return 0.5 * (self.below + self.above)


STANDSTILL_SPEED = "stribeck_friction.speed_rad_s"
"""Within which friction near standstill falls off."""
_STANDSTILL = "stribeck_friction.extra_nm"
_TRADED_WITH_IT = frozenset({_STANDSTILL, "coulomb_friction.torque_nm", "directional_friction.difference_nm", TORQUE_CONSTANT})


def usual_errors(key: str, where: str, standstill_rad_s: float | None) -> UsualErrors:
    """What is to be added to a value's interval, in its unit.

    None for what was never named on those robots: it takes over nothing. What was named elsewhere alone has the largest of there.

    Args:
        key: "effect.parameter".
        where: a joint or the platform.
        standstill_rad_s: speed within which friction near standstill falls off at that joint; None where none was found.
    """
    found = _kept().get(key, {})
    elsewhere = UsualErrors(*(max((errors[side] for errors in found.values()), default=0.0) for side in (0, 1)))
    return found.get(circumstance(key, where, standstill_rad_s), elsewhere)


@cache
def _kept() -> dict[str, dict[str, UsualErrors]]:
    errors = json.loads(FILE.read_text())["errors"]
    return {key: {at: UsualErrors(*sides) for at, sides in of.items()} for key, of in errors.items()}


def circumstance(key: str, where: str, standstill_rad_s: float | None) -> str:
    """Place in the finger, and of what friction near standstill trades with whether its speed is seen there: half-way between the
    two least that are probed, or faster.
    """
    place = place_in_finger(where)
    if key not in _TRADED_WITH_IT:
        return place
    if standstill_rad_s is None:
        return f"{place}, no friction near standstill"
    return f"{place}, its speed unseen" if standstill_rad_s < _least_seen_rad_s() else place


@cache
def _least_seen_rad_s() -> float:
    shape = NUMBERS[_STANDSTILL].shape
    assert shape is not None, "its speed"
    return float(np.sqrt(shape.values[0] * shape.values[1]))


def place_in_finger(where: str) -> str:
    """Of a joint what all fingers have at its place, such as "base_to_upper"; of anything else its name."""
    finger, _, place = where.partition("_")
    return place if place and finger.startswith("finger") else where


def is_telling(key: str, where: str, standstill_rad_s: float | None) -> bool:
    """Whether a value can show by itself, where a robot differs everywhere, that its effect is there."""
    return key in NUMBERS and usual_errors(key, where, standstill_rad_s).half <= TELLING * SCALES[key]


def deviation(key: str, value: float, truth: float) -> float:
    """How far a value lies from the truth, in its unit; turns of motors have no whole ones."""
    off = value - truth
    return float((off + np.pi) % (2.0 * np.pi) - np.pi) if key in TURNS_OF_MOTORS else off


def measured_errors(robots: Sequence[Sequence[Mapping]]) -> dict[str, dict[str, UsualErrors]]:
    """By parameter and circumstance, what must be added to the intervals of some values so that so many of them hold the truth.

    Args:
        robots: the values of each: ``key``, ``where``, ``value``, ``truth`` and ``own``, half of the interval by noise alone.
    """
    return {
        key: {at: UsualErrors(_largest(values), _largest([-off for off in values])) for at, values in of.items()}
        for key, of in _beyond_own(robots).items()
    }


def document(robots: Sequence[Sequence[Mapping]], seeds: Sequence[int]) -> dict:
    """The calibration file: errors, and of how many values each is."""
    return {
        "errors": measured_errors(robots),
        "values": {key: {at: len(values) for at, values in of.items()} for key, of in _beyond_own(robots).items()},
        "robots": len(seeds),
        "seeds": list(seeds),
    }


def _beyond_own(robots: Sequence[Sequence[Mapping]]) -> dict[str, dict[str, list[float]]]:
    """By parameter and circumstance how far values lie above the truth beyond what their own noise explains; sorted by name."""
    beyond: dict[str, dict[str, list[float]]] = {}
    for rows in robots:
        values = {(row["key"], row["where"]): row["value"] for row in rows}
        for row in rows:
            key, where = row["key"], row["where"]
            off = deviation(key, row["value"], row["truth"])
            at = beyond.setdefault(key, {}).setdefault(circumstance(key, where, values.get((STANDSTILL_SPEED, where))), [])
            at.append(float(np.sign(off) * np.sqrt(max(0.0, off**2 - row["own"] ** 2))))
    return {key: dict(sorted(of.items())) for key, of in sorted(beyond.items())}


def _largest(values: Sequence[float]) -> float:
    """What also the next value stays below with the wanted chance, at least 0; the largest where there are too few to tell."""
    rank = int(np.ceil((len(values) + 1) * 0.5 * (1.0 + COVERED)))
    return max(0.0, sorted(values)[min(rank, len(values)) - 1])


def likeliest(key: str, value: float, interval_90: tuple[float, float], nominal: float) -> float:
    """A fitted value, drawn towards the nominal one as far as it is unsure on that side and large for its parameter.

    The mean of what is usual of the parameter and of what was fitted. Between many causes a value may run to its bound while
    another makes up for it, which no motion like those that were recorded shows; any other motion would.
    """
    if key not in SCALES:
        return value
    unsure = (value - interval_90[0] if value > nominal else interval_90[1] - value) / Z_90
    return nominal + (value - nominal) * SCALES[key] ** 2 / (SCALES[key] ** 2 + unsure**2)
