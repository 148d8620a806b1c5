"""Contrasts: a difference with its interval, what it could have shown, and what it says.

All intervals are two-sided at 80 %, as the farm's are.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import norm, t

from api_schemas.comparison import paired_interval
from experiments.design import Contrast

LEVEL = 0.80
POWER = 0.80
CHANGING_SIDES = 0.3
"""Share of goals that two policies end differently, for what is said of power before a run."""


class Verdict(StrEnum):
    """What a contrast says of a paper's claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    NOT_RUN = "not run yet"


@dataclass(frozen=True)
class Difference:
    """Other minus first: the estimate, its 80 % interval, and from how many trials and runs."""

    estimate: float
    low: float
    high: float
    n: int
    runs: int

    @property
    def width(self) -> float:
        """Of the interval."""
        return self.high - self.low


def verdict(contrast: Contrast, found: Difference | None) -> Verdict:
    """What a difference says; one that chance explains and that is known too badly for the effect of interest is undecided.

    Without ``loss`` the claim is a gain: an interval above 0 reproduces it; one below 0, or one that holds 0 and is no wider than
    the effect of interest, does not. With ``loss`` the claim is that less than the effect of interest is lost.
    """
    if found is None:
        return Verdict.NOT_RUN
    if found.low <= 0 <= found.high and found.width > contrast.interest:
        return Verdict.UNDECIDED
    if not contrast.loss:
        return Verdict.REPRODUCED if found.low > 0 else Verdict.NOT_REPRODUCED
    if found.low > -contrast.interest:
        return Verdict.REPRODUCED
    return Verdict.NOT_REPRODUCED if found.high < -contrast.interest else Verdict.UNDECIDED


def paired_success(first: Sequence[Mapping[int, bool]], other: Sequence[Mapping[int, bool]]) -> Difference | None:
    """Difference of success rates on the same goals.

    Args:
        first: for each run (seed) of the first cell whether it reached each goal, by the goal's seed.
        other: the same of the other cell, run by run.

    Returns:
        None without a goal in common. With one run each Tango's interval of the paired difference, which speaks of these two
        policies only; with more the wider of that over all pairs and Student's over the runs' differences, so that neither the
        chance of trials nor that of trainings is left out.
    """
    gained = lost = goals = 0
    of_runs = []
    for before, after in zip(first, other, strict=False):
        common = [(before[goal], after[goal]) for goal in before if goal in after]
        if not common:
            continue
        more, fewer = common.count((False, True)), common.count((True, False))
        gained, lost, goals = gained + more, lost + fewer, goals + len(common)
        of_runs.append((more - fewer) / len(common))
    if not goals:
        return None
    estimate = (gained - lost) / goals
    low, high = paired_interval(gained, lost, goals, LEVEL)
    if len(of_runs) > 1:
        around = student(of_runs)
        low, high = min(low, around.low), max(high, around.high)
    return Difference(estimate, low, high, goals, len(of_runs))


def student(values: Sequence[float]) -> Difference:
    """Mean of a few values with Student's interval; infinitely wide for a single one."""
    n, mean = len(values), float(np.mean(values))
    if n < 2:
        return Difference(mean, -math.inf, math.inf, n, n)
    half = float(t.ppf((1 + LEVEL) / 2, n - 1) * np.std(values, ddof=1) / math.sqrt(n))
    return Difference(mean, mean - half, mean + half, n, n)


def welch(first: Sequence[float], other: Sequence[float]) -> Difference:
    """Difference of two means with Welch's interval; each needs two values."""
    a, b = np.asarray(first, dtype=float), np.asarray(other, dtype=float)
    of_a, of_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    estimate, error = float(b.mean() - a.mean()), math.sqrt(of_a + of_b)
    if error == 0.0:
        return Difference(estimate, estimate, estimate, len(a) + len(b), 1)
    freedom = (of_a + of_b) ** 2 / (of_a**2 / (len(a) - 1) + of_b**2 / (len(b) - 1))
    half = float(t.ppf((1 + LEVEL) / 2, freedom)) * error
    return Difference(estimate, estimate - half, estimate + half, len(a) + len(b), 1)


def samples_to(evaluations: Sequence[Mapping], rate: float, budget: int) -> tuple[int, bool]:
    """Samples at the first evaluation on nominal robots that reaches the rate, and whether one did; the budget if none did."""
    for each in evaluations:
        if each["physics"] == "nominal" and each["success_rate"] >= rate:
            return each["samples"], True
    return budget, False


def times_fewer(first: Sequence[tuple[int, bool]], other: Sequence[tuple[int, bool]]) -> Difference | None:
    """Log2 of how many times fewer samples the other cell's runs took, run by run.

    A run that never arrived counts with its budget: the first cell's then makes the saving smaller than it is, which is fair to
    the claim; where the other cell's did not arrive nothing is known above, and the interval is open there.
    """
    pairs = list(zip(first, other, strict=False))
    if not pairs:
        return None
    found = student([math.log2(before / after) for (before, _), (after, _) in pairs])
    known = all(arrived for _, (_, arrived) in pairs)
    return found if known else Difference(found.estimate, -math.inf, math.inf, found.n, found.runs)


def detectable(pairs: int, changing_sides: float = CHANGING_SIDES) -> float:
    """The difference of paired rates that such a design tells from 0 in four of five repetitions, by the normal law."""
    z = norm.ppf((1 + LEVEL) / 2) + norm.ppf(POWER)
    return float(z * math.sqrt(changing_sides / pairs))
