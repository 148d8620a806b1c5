"""Hypotheses about a tossed object, and the search for the values at which each explains the data best."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.tosses import OBJECT, TOSSED, TossEffect
from sim_backend.reality_gap.subjects.tosses.evidence import TossEvidence
from sim_backend.reality_gap.subjects.tosses.likelihood import Point, total, weights
from sim_backend.reality_gap.subjects.tosses.models import GRAVITY

_REFINE = 7  # evaluations of a refinement
_SHARES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # of the range, in both directions, where a value may have either sign
_LOG_STEPS = (0.02, 0.06, 0.2, 0.6, 1.8)  # of the logarithm, in both directions, where it must be positive
_GRAVITY_M_S2 = 3.0  # the catalogue's 10 would let an object fly off


@dataclass(frozen=True)
class TossHypothesis:
    """One effect as the cause, and where it would act."""

    known: TossEffect
    where: str

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.known.effect

    @property
    def keys(self) -> tuple[str, ...]:
        """Its numbers, "effect.parameter"."""
        return self.known.keys


@dataclass(frozen=True)
class TossSearch:
    """What a search works on: the evidence, the tosses under study, and the few of them for a first look."""

    evidence: TossEvidence
    rows: np.ndarray
    first: np.ndarray

    def point(self, values: Mapping[str, float]) -> Point:
        """Residuals of the tosses under study."""
        return Point(dict(values), self.evidence.residuals(values, self.rows.tolist()))

    def score(self, point: Point) -> float:
        """Log density of all tosses under study, nats."""
        return total(self.evidence.kinds, weights(self.evidence.kinds, point.residuals), point.residuals)

    def first_score(self, values: Mapping[str, float]) -> float:
        """Log density of the few tosses of a first look, nats."""
        residuals = self.evidence.residuals(values, self.first.tolist())
        return total(self.evidence.kinds, weights(self.evidence.kinds, residuals), residuals)


def hypotheses_of(body: str) -> tuple[TossHypothesis, ...]:
    """All effects of the catalogue that toss data can speak of."""
    return tuple(TossHypothesis(known, body if known.where == OBJECT else known.where) for known in TOSSED)


def bounds_of(key: str) -> tuple[float, float]:
    """Least and largest value that a search tries."""
    parameter = PARAMETERS[key]
    return (-_GRAVITY_M_S2, _GRAVITY_M_S2) if key == GRAVITY else (parameter.lower, parameter.upper)


def grid_of(key: str, start: float) -> np.ndarray:
    """Values of a first look: the start and growing steps to both sides of it, as far as the bounds."""
    lower, upper = bounds_of(key)
    if lower > 0.0:
        values = start * np.exp(np.concatenate([-np.array(_LOG_STEPS), _LOG_STEPS]))
    else:
        values = start + upper * np.concatenate([-np.array(_SHARES), _SHARES])
    return np.unique(np.append(np.clip(values, lower, upper), start))


@dataclass(frozen=True)
class FirstLook:
    """Best values of a first look, the neighbours between which the best may lie, and the gain promised for all tosses, nats."""

    hypothesis: TossHypothesis
    values: Mapping[str, float]
    brackets: Mapping[str, tuple[float, float]]
    promise: float


def first_look(study: TossSearch, hypothesis: TossHypothesis, base: Mapping[str, float]) -> FirstLook:
    """A grid over each parameter in turn, on few tosses."""
    values, brackets = dict(base), {}
    start = best = study.first_score(values)
    for key in hypothesis.keys:
        grid = grid_of(key, values[key])
        if not _makes_a_difference(study, key, values, grid):
            continue
        scores = [best if value == values[key] else study.first_score({**values, key: float(value)}) for value in grid]
        place = int(np.argmax(scores))
        brackets[key] = float(grid[max(place - 1, 0)]), float(grid[min(place + 1, len(grid) - 1)])
        values[key], best = float(grid[place]), float(scores[place])
    return FirstLook(hypothesis, values, brackets, (best - start) * len(study.rows) / len(study.first))


def explored(study: TossSearch, look: FirstLook, base: Point, refine: bool) -> list[Point]:
    """Points of a hypothesis on all tosses: the best of its first look, and those of a search around it if it may win."""
    if not look.brackets or not refine:
        return [] if look.values == base.values else [study.point(look.values)]
    best, points = study.point(look.values), []
    for key, bracket in look.brackets.items():
        found = line(study, key, best, bracket)
        points += [best, *found]
        best = max([best, *found], key=study.score)
    return points


def line(study: TossSearch, key: str, base: Point, bracket: tuple[float, float]) -> list[Point]:
    """Points between two values of one parameter, closer to each other near the best one; all else as in ``base``."""
    lower, upper = bracket
    if lower == upper:
        return []
    ratio, points = bounds_of(key)[0] > 0.0, []

    def worse(x: float) -> float:
        point = study.point({**base.values, key: float(np.exp(x)) if ratio else float(x)})
        points.append(point)
        return -study.score(point)

    ends = tuple(np.log(bracket)) if ratio else bracket
    minimize_scalar(worse, bounds=ends, method="bounded", options={"maxiter": _REFINE, "xatol": 1e-3 * (ends[1] - ends[0])})
    return points


def refitted(study: TossSearch, keys: tuple[str, ...], base: Point, width: float = 0.15) -> tuple[Point, list[Point]]:
    """The best point when each of several parameters is searched again around its value; and all points tried.

    Args:
        study: what it works on.
        keys: of the parameters, in the order of the search.
        base: to start from.
        width: of the search, as a share of the value, or of the parameter's range where it may have either sign.
    """
    points, best = [], base
    for key in keys:
        found = line(study, key, best, around(key, best.values[key], width))
        points += found
        best = max([best, *found], key=study.score)
    return best, points


def around(key: str, value: float, width: float) -> tuple[float, float]:
    """Values around one, within the bounds."""
    lower, upper = bounds_of(key)
    reach = width * value if lower > 0.0 else 0.2 * width * upper
    return max(value - reach, lower), min(value + reach, upper)


def _makes_a_difference(study: TossSearch, key: str, values: Mapping[str, float], grid: np.ndarray) -> bool:
    """Whether the ends of a range differ in their residuals; mass does not where nothing else pushes the object."""
    few = study.first[:6].tolist()
    ends = [study.evidence.residuals({**values, key: float(end)}, few) for end in (grid[0], grid[-1])]
    return not all(np.allclose(ends[0][name], ends[1][name], rtol=1e-6, atol=1e-9, equal_nan=True) for name in ends[0])
