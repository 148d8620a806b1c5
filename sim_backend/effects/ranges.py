"""Ranges of effects: a table that says how robots differ, each row with its source, and physics drawn from it."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Parameter
from sim_backend.effects.estimate import Draw, Estimate, take_estimate
from sim_backend.effects.physics import Physics

PRESET_NAMES = ("nominal", "mild", "real", "dactyl", "allshire", "isaacgymenvs", "real-images", "real-2")
_PRESETS = Path(__file__).parent / "presets"
_FIELDS = {"key", "distribution", "low", "high", "value", "per", "each", "source", "dated"}


class Distribution(StrEnum):
    """How a number is drawn between ``low`` and ``high``."""

    FIXED = "fixed"  # always low, which equals high
    UNIFORM = "uniform"
    LOGUNIFORM = "loguniform"
    GAUSSIAN = "gaussian"  # low and high are one standard deviation off the mean; cut off at the parameter's bounds
    EITHER = "either"  # one or the other, equally likely


class Per(StrEnum):
    """How long a number stays the same."""

    ROBOT = "robot"
    EPISODE = "episode"


@dataclass(frozen=True)
class Range:
    """One row: the parameter, where its value may lie, and why.

    With ``each`` every joint, camera or axis gets a number of its own; otherwise all of a robot's share one.

    Raises:
        ValueError: on an unknown parameter, bounds that it does not allow, or a missing source.
    """

    key: str
    distribution: Distribution
    low: float
    high: float
    per: Per
    each: bool
    source: str
    dated: date

    def __post_init__(self) -> None:
        parameter, between = self.parameter, f"{self.key} lies between {self.low:g} and {self.high:g}"
        if not self.low <= self.high:
            raise ValueError(f"{between}; the first must not be larger")
        if not parameter.lower <= self.low <= self.high <= parameter.upper:
            raise ValueError(f"{between}; the catalogue allows {parameter.lower:g} to {parameter.upper:g}")
        if self.distribution is Distribution.FIXED and self.low != self.high:
            raise ValueError(f"{between}; a fixed one has a single value")
        if self.distribution is Distribution.LOGUNIFORM and self.low <= 0.0:
            raise ValueError(f"{self.key} is loguniform from {self.low:g}; it must begin above 0")
        if self.each and parameter.width == 1:
            raise ValueError(
                f"{self.key} has one number for each robot; 'each' is for those with one for each joint, camera or axis"
            )
        if not self.source.strip():
            raise ValueError(f"{self.key} has no source; give one, or the reason for its range")

    @property
    def parameter(self) -> Parameter:
        """The catalogue's entry."""
        if self.key not in PARAMETERS:
            raise ValueError(f"unknown parameter {self.key!r}; `python -m sim_backend.effects` lists them")
        return PARAMETERS[self.key]

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Values for n robots: shape (n,), or (n, 9) or (n, 3) for a parameter with one for each joint, camera or axis."""
        width = self.parameter.width
        drawn = self._drawn(rng, (n, width if self.each else 1))
        drawn = np.clip(drawn, self.parameter.lower, self.parameter.upper)
        return drawn[:, 0] if width == 1 else np.broadcast_to(drawn, (n, width)).copy()

    def _drawn(self, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
        match self.distribution:
            case Distribution.FIXED:
                return np.full(shape, self.low)
            case Distribution.UNIFORM:
                return rng.uniform(self.low, self.high, shape)
            case Distribution.LOGUNIFORM:
                return np.exp(rng.uniform(np.log(self.low), np.log(self.high), shape))
            case Distribution.GAUSSIAN:
                return rng.normal((self.low + self.high) / 2, (self.high - self.low) / 2, shape)
            case Distribution.EITHER:
                return np.where(rng.random(shape) < 0.5, self.low, self.high)


@dataclass(frozen=True)
class Ranges:
    """A named table of ranges, on top of the physics that all its robots share; ``estimate`` says how a study found it."""

    name: str
    about: str
    rows: tuple[Range, ...]
    shared: Physics
    estimate: Estimate = field(default_factory=Estimate)

    def draw(self, rng: np.random.Generator, n: int) -> Physics:
        """Physics of n robots: what stays the same for a robot's life. Other effects are absent."""
        shared = self.estimate.draw(rng, Physics.stack([self.shared] * n))
        return shared.changed({row.key: row.draw(rng, n) for row in self.rows if row.per is Per.ROBOT})

    def draw_episode(self, rng: np.random.Generator, physics: Physics) -> Physics:
        """The same robots with what differs from episode to episode drawn anew."""
        return physics.changed({row.key: row.draw(rng, physics.n) for row in self.rows if row.per is Per.EPISODE})


def load_ranges(name_or_path: str | Path) -> Ranges:
    """A preset by its name, or a TOML file: a table of ranges, or the physics of one robot, which all robots then share.

    The file of an extended model (``reality_gap/model/model.py``) also says where its values come from and how sure they are.
    A file that ``extends`` a preset has that one's rows before its own: the same robots, and what its own rows add. Rows of the
    same parameter stand in the place of the preset's; where they are drawn in the same way, all else of a robot stays the same.

    Raises:
        ValueError: neither a preset nor a readable file, or a row that does not hold; the message says which.
    """
    is_preset = name_or_path in PRESET_NAMES
    path = _PRESETS / f"{name_or_path}.toml" if is_preset else Path(name_or_path)
    if not path.is_file():
        raise ValueError(f"no physics {str(name_or_path)!r}; choose from {', '.join(PRESET_NAMES)}, or name a TOML file")
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    about = document.pop("about", "")
    extended = document.pop("extends", None)
    if extended is not None and extended not in PRESET_NAMES:
        raise ValueError(f"{path} extends {extended!r}; choose from {', '.join(PRESET_NAMES)}")
    rows = _rows(path, document.pop("range", []), () if extended is None else load_ranges(extended).rows)
    try:
        estimate = take_estimate(document)
        physics = Physics.from_document(document)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    twice = sorted({interval.key for interval in estimate.intervals} & {row.key for row in rows})
    if twice and estimate.draws is Draw.INTERVAL_90:
        raise ValueError(f"{path}: {', '.join(twice)} is drawn from both a range and an interval")
    return Ranges(path.stem, str(about), rows, physics, estimate)


def _rows(path: Path, entries: Any, before: tuple[Range, ...]) -> tuple[Range, ...]:
    if not isinstance(entries, Sequence) or not all(isinstance(entry, Mapping) for entry in entries):
        raise ValueError(f"{path}: 'range' must be a list of tables, each begun with [[range]]")
    own = tuple(_row(path, number, entry) for number, entry in enumerate(entries, 1))
    keys = [row.key for row in own]
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:
        raise ValueError(f"{path}: {', '.join(twice)} has more than one range")
    places, known = dict(zip(keys, own, strict=True)), {row.key for row in before}
    return (*(places.get(row.key, row) for row in before), *(row for row in own if row.key not in known))


def _row(path: Path, number: int, entry: Mapping[str, Any]) -> Range:
    where = f"{path}, range {number} ({entry.get('key', 'no key')})"
    unknown = sorted(set(entry) - _FIELDS)
    if unknown:
        raise ValueError(f"{where}: unknown {', '.join(unknown)}; choose from {', '.join(sorted(_FIELDS))}")
    try:
        low, high = (entry["value"], entry["value"]) if "value" in entry else (entry["low"], entry["high"])
        return Range(
            key=entry["key"],
            distribution=Distribution(entry["distribution"]),
            low=float(low),
            high=float(high),
            per=Per(entry["per"]),
            each=bool(entry.get("each", False)),
            source=entry["source"],
            dated=entry["dated"],
        )
    except KeyError as error:
        raise ValueError(f"{where}: {error.args[0]!r} is missing") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error
