"""Geometry of the pages' figures: numbers in, points of a square of 100 by 100 out, which the page stretches as it likes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from api_schemas.anytime import rate_sequence
from api_schemas.success_rate import SHOWN_LEVEL, wilson
from report_views import error_axis

MOST_POINTS = 200
"""Of a curve; of more trials some are left out."""


@dataclass(frozen=True)
class Curve:
    """The success rate so far: its band and its line, as the points of a polygon and of a polyline."""

    band: str
    line: str


@dataclass(frozen=True)
class Bar:
    """A success rate with its interval, in percent of the width."""

    name: str
    successes: int
    trials: int
    rate: float
    low: float
    high: float

    @classmethod
    def of(cls, name: str, successes: int, trials: int, *, at_every_look: bool = False) -> "Bar":
        """The bar of some trials; that of a number that is still growing has an interval that holds at every look."""
        low, high = (rate_sequence if at_every_look else wilson)(successes, trials, SHOWN_LEVEL)
        return cls(name, successes, trials, 100 * successes / trials if trials else 0.0, 100 * low, 100 * high)


@dataclass(frozen=True)
class Dot:
    """One trial's end, by the logarithm of its distance from the goal."""

    x: float
    y: float
    succeeded: bool


def narrowing(steps: Sequence[tuple[int, int]], trials: int) -> Curve:
    """The rate after each trial with its confidence sequence, which holds at all of them together.

    Args:
        steps: trials done and successes, in their order.
        trials: of the whole job, which is the width.
    """
    every = max(1, len(steps) // MOST_POINTS)
    shown = [step for index, step in enumerate(steps, 1) if step[0] and (index % every == 0 or index == len(steps))]
    at = [(100 * done / trials, rate_sequence(successes, done, SHOWN_LEVEL), successes / done) for done, successes in shown]
    lower = [f"{x:.2f},{100 - 100 * bounds[0]:.2f}" for x, bounds, _ in at]
    upper = [f"{x:.2f},{100 - 100 * bounds[1]:.2f}" for x, bounds, _ in at]
    return Curve(" ".join(upper + lower[::-1]), " ".join(f"{x:.2f},{100 - 100 * rate:.2f}" for x, _, rate in at))


def error_x(error_m: float) -> float:
    """Where an error lies, in percent of the width."""
    return 100 * error_axis.along(1e3 * error_m)


def dots(errors: Sequence[tuple[float, bool]]) -> list[Dot]:
    """Trials by their final error; neighbours are spread over the height so that none hides another."""
    return [Dot(error_x(error), 14 + 72 * error_axis.across(index), done) for index, (error, done) in enumerate(errors)]


def turned(errors: Sequence[tuple[float, bool]]) -> list[Dot]:
    """Trials by their final angle error in rad, on an axis from 0 to 180 degrees."""
    return [Dot(angle_x(error), 14 + 72 * error_axis.across(index), done) for index, (error, done) in enumerate(errors)]


def angle_x(error_rad: float) -> float:
    """Where an angle error lies, in percent of the width."""
    return 100 * min(error_rad, math.pi) / math.pi


def ticks() -> list[tuple[float, str]]:
    """Where the axis of the errors is labelled."""
    return [(error_x(mm / 1e3), str(mm)) for mm in error_axis.TICKS_MM]


@dataclass(frozen=True)
class Stop:
    """A rung of a ladder in the figure; ``y`` counts from the top."""

    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True)
class Climb:
    """A ladder's figure: its stops, the line through them, and where its axis is labelled."""

    stops: tuple[Stop, ...]
    line: str
    ticks: tuple[tuple[float, str], ...]


MARGIN = 3.0
"""Percent of the width beside the first and the last stop."""
MOST_TICKS = 6


def climbing(rungs: Sequence[tuple[float, Bar]]) -> Climb:
    """Success against step, for the rungs of which trials are done; the axis goes over the steps of all."""
    steps = [step for step, _ in rungs]
    low, high = min(steps), max(steps)

    def along(step: float) -> float:
        return 50.0 if high == low else MARGIN + (100 - 2 * MARGIN) * (step - low) / (high - low)

    stops = tuple(Stop(along(step), 100 - bar.rate, 100 - bar.low, 100 - bar.high) for step, bar in rungs if bar.trials)
    line = " ".join(f"{stop.x:.2f},{stop.y:.2f}" for stop in stops)
    labelled = _spread(sorted(set(steps)), along)
    return Climb(stops, line, tuple((along(step), short(step)) for step in labelled))


def _spread(steps: Sequence[float], along: Callable[[float], float]) -> list[float]:
    """Of the steps those whose labels do not touch: the last one always, others where there is room."""
    kept = [steps[-1]]
    for step in reversed(steps[:-1]):
        if along(kept[-1]) - along(step) >= 100 / MOST_TICKS:
            kept.append(step)
    return kept[::-1]


def short(step: float) -> str:
    """A step as an axis names it, such as 500, 20 k or 1.5 M."""
    for factor, unit in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if abs(step) >= factor:
            return f"{step / factor:.4g}{unit}"
    return f"{step:.6g}"
