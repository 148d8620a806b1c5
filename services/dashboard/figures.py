"""Geometry of the pages' figures: numbers in, points of a square of 100 by 100 out, which the page stretches as it likes."""

from collections.abc import Sequence
from dataclasses import dataclass

from api_schemas import error_axis
from api_schemas.success_rate import wilson

LEVEL = 0.80


@dataclass(frozen=True)
class Curve:
    """A success rate as it narrows: its band and its line, as the points of a polygon and of a polyline."""

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
    def of(cls, name: str, successes: int, trials: int) -> "Bar":
        """The bar of some trials."""
        low, high = wilson(successes, trials, LEVEL)
        return cls(name, successes, trials, 100 * successes / trials if trials else 0.0, 100 * low, 100 * high)


@dataclass(frozen=True)
class Dot:
    """One trial's end, by the logarithm of its distance from the goal."""

    x: float
    y: float
    succeeded: bool


def narrowing(steps: Sequence[tuple[int, int]], trials: int) -> Curve:
    """The rate after each trial that ended.

    Args:
        steps: trials done and successes, in their order.
        trials: of the whole job, which is the width.
    """
    at = [(100 * done / trials, wilson(successes, done, LEVEL), successes / done) for done, successes in steps if done]
    lower = [f"{x:.2f},{100 - 100 * bounds[0]:.2f}" for x, bounds, _ in at]
    upper = [f"{x:.2f},{100 - 100 * bounds[1]:.2f}" for x, bounds, _ in at]
    return Curve(" ".join(upper + lower[::-1]), " ".join(f"{x:.2f},{100 - 100 * rate:.2f}" for x, _, rate in at))


def error_x(error_m: float) -> float:
    """Where an error lies, in percent of the width."""
    return 100 * error_axis.along(1e3 * error_m)


def dots(errors: Sequence[tuple[float, bool]]) -> list[Dot]:
    """Trials by their final error; neighbours are spread over the height so that none hides another."""
    return [Dot(error_x(error), 14 + 72 * error_axis.across(index), done) for index, (error, done) in enumerate(errors)]


def ticks() -> list[tuple[float, str]]:
    """Where the axis of the errors is labelled."""
    return [(error_x(mm / 1e3), str(mm)) for mm in error_axis.TICKS_MM]
