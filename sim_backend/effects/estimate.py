"""What a study says about the values in a file of physics: where they come from and how sure they are."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Parameter, Scope
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c

PLACES: dict[Scope, tuple[str, ...]] = {
    Scope.JOINT: c.JOINT_NAMES,
    Scope.CAMERA: tuple(camera.name for camera in c.CAMERAS),
    Scope.VECTOR: ("x", "y", "z"),
    Scope.FACE: tuple(c.CUBE_FACE_COLOURS),
}
"""Names of a parameter's places, in the order of its values."""
EVERYWHERE: dict[Scope, str] = {
    Scope.JOINT: "all joints",
    Scope.CAMERA: "camera",
    Scope.VECTOR: "all axes",
    Scope.FACE: "all faces",
}
"""What stands for all of them: one number that they share."""
_SHA256 = re.compile("[0-9a-f]{64}")


class Draw(StrEnum):
    """What robots with a file's physics have: the values themselves, or values from within their intervals."""

    VALUE = "value"
    INTERVAL_90 = "interval_90"


@dataclass(frozen=True)
class DataFile:
    """A file that values were fitted to."""

    file: str
    sha256: str


@dataclass(frozen=True)
class Provenance:
    """Which study the values come from: its title, when it was made (ISO 8601), the code's version, its verdict, its data."""

    title: str
    created: str
    code: str
    verdict: str
    data: tuple[DataFile, ...] = ()


@dataclass(frozen=True)
class Interval:
    """The 90 % interval of a parameter's value at one place (see :func:`place_index`)."""

    key: str
    where: str
    low: float
    high: float

    @property
    def parameter(self) -> Parameter:
        """The catalogue's entry."""
        return PARAMETERS[self.key]


@dataclass(frozen=True)
class Estimate:
    """Everything that a file says besides values; with ``Draw.INTERVAL_90`` robots differ by what the study left open."""

    provenance: Provenance | None = None
    intervals: tuple[Interval, ...] = ()
    draws: Draw = Draw.VALUE

    def draw(self, rng: np.random.Generator, physics: Physics) -> Physics:
        """The robots' physics, as it is or with each estimated value drawn anew, uniformly within its interval and bounds."""
        if self.draws is Draw.VALUE:
            return physics
        values = {interval.key: physics.value(interval.key).copy() for interval in self.intervals}
        for interval in self.intervals:
            parameter = interval.parameter
            drawn = np.clip(rng.uniform(interval.low, interval.high, physics.n), parameter.lower, parameter.upper)
            index = place_index(parameter, interval.where)
            if parameter.width == 1:
                values[interval.key][:] = drawn
            elif index is None:
                values[interval.key][:] = drawn[:, None]
            else:
                values[interval.key][:, index] = drawn
        return physics.changed(values)


def place_index(parameter: Parameter, where: str) -> int | None:
    """Which of a parameter's values belongs to a place: its index, or None for all of them and for a single one.

    Raises:
        ValueError: the parameter has no such place; the message names those that it has.
    """
    if parameter.scope is Scope.GLOBAL or where == EVERYWHERE[parameter.scope]:
        return None
    places = PLACES[parameter.scope]
    if where not in places:
        choices = ", ".join((*places, EVERYWHERE[parameter.scope]))
        raise ValueError(f"{parameter.name} has no value for {where!r}; choose from {choices}")
    return places.index(where)


def take_estimate(document: dict[str, Any]) -> Estimate:
    """Take out of a file's document what is not physics: ``provenance``, ``interval_90`` and ``draw``.

    Raises:
        ValueError: one of them is not as :class:`Provenance`, :class:`Interval` or :class:`Draw` say.
    """
    provenance, intervals = document.pop("provenance", None), document.pop("interval_90", [])
    draws = document.pop("draw", Draw.VALUE.value)
    if draws not in list(Draw):
        raise ValueError(f"draw is {draws!r}; choose from {', '.join(Draw)}")
    if not isinstance(intervals, Sequence) or isinstance(intervals, str):
        raise ValueError("'interval_90' must be a list of tables, each begun with [[interval_90]]")
    rows = tuple(_interval(f"interval_90 {number}", entry) for number, entry in enumerate(intervals, 1))
    places = [(row.key, row.where) for row in rows]
    if len(set(places)) < len(places):
        raise ValueError(f"interval_90 gives {max(places, key=places.count)} more than once")
    return Estimate(None if provenance is None else _provenance(provenance), rows, Draw(draws))


def _provenance(table: Any) -> Provenance:
    known = {"title": str, "created": str, "code": str, "verdict": str, "data": list}
    _check("provenance", table, known, optional={"data"})
    for number, entry in enumerate(table.get("data", []), 1):
        _check(f"provenance.data {number}", entry, {"file": str, "sha256": str})
        if not _SHA256.fullmatch(entry["sha256"]):
            raise ValueError(f"provenance.data {number}: sha256 is {entry['sha256']!r}; it must be 64 hexadecimal digits")
    data = tuple(DataFile(entry["file"], entry["sha256"]) for entry in table.get("data", []))
    return Provenance(table["title"], table["created"], table["code"], table["verdict"], data)


def _interval(name: str, entry: Any) -> Interval:
    _check(name, entry, {"key": str, "where": str, "low": (int, float), "high": (int, float)}, optional={"where"})
    if entry["key"] not in PARAMETERS:
        raise ValueError(f"{name}: unknown parameter {entry['key']!r}; `python -m sim_backend.effects` lists them")
    interval = Interval(entry["key"], entry.get("where", ""), float(entry["low"]), float(entry["high"]))
    if not -np.inf < interval.low <= interval.high < np.inf:
        raise ValueError(f"{name}: from {interval.low:g} to {interval.high:g}; both must be finite, the first not larger")
    place_index(interval.parameter, interval.where)
    return interval


def _check(name: str, table: Any, kinds: Mapping[str, Any], optional: set[str] | None = None) -> None:
    """That a table has the keys it must have, no other, and each of its kind."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{name} is {table!r}; it must be a table of {', '.join(kinds)}")
    unknown, missing = sorted(set(table) - set(kinds)), sorted(set(kinds) - set(table) - (optional or set()))
    if unknown:
        raise ValueError(f"{name}: unknown {', '.join(unknown)}; choose from {', '.join(kinds)}")
    if missing:
        raise ValueError(f"{name}: {', '.join(missing)} is missing")
    for key, value in table.items():
        if not isinstance(value, kinds[key]) or isinstance(value, bool):
            raise ValueError(f"{name}: {key} is {value!r}; that is not the kind of value it must have")
