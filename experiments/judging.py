"""Contrasts: a difference with its interval, and what it says.

All intervals are two-sided at 80 %, as the farm's are.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

import numpy as np
from scipy.stats import t

from api_schemas.comparison import paired_interval
from api_schemas.success_rate import wilson
from experiments.design import Contrast, Measure

LEVEL = 0.80


class Verdict(StrEnum):
    """What a contrast says of a paper's claim, or of a question of ours."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    FOUND = "found"
    NOT_FOUND = "not found"
    UNDECIDED = "undecided"
    NOT_RUN = "not run yet"


class Chance(StrEnum):
    """What an interval is over."""

    TRIALS = "trials"
    RUNS = "runs"
    GOALS = "goals"
    ROBOTS = "robots"


@dataclass(frozen=True)
class Difference:
    """Other minus first: the estimate, its 80 % interval, and from how many trials and runs.

    ``robots`` is on how many of a farm's robots that differ both sides were tried, 0 where robots are alike or each trial has
    one of its own; ``widest`` which chance sets the lower bound and which the upper one.
    """

    estimate: float
    low: float
    high: float
    n: int
    runs: int
    robots: int = 0
    widest: tuple[Chance, Chance] = (Chance.TRIALS, Chance.TRIALS)

    @property
    def width(self) -> float:
        """Of the interval."""
        return self.high - self.low


@dataclass(frozen=True)
class Arrival:
    """Samples at which a run first had a success rate: it was not there ``after`` so many, and was ``by`` so many.

    ``by`` is None if it never was; ``after`` is its budget then.
    """

    after: int
    by: int | None

    @property
    def samples(self) -> int:
        """At the evaluation that showed it; the budget if none did."""
        return self.after if self.by is None else self.by

    @property
    def before_practice(self) -> bool:
        """Whether the first evaluation, of what was cloned before any practice, showed it already."""
        return self.by == self.after


def verdict(contrast: Contrast, found: Difference | None, hidden: str = "") -> Verdict:
    """What a difference says.

    Without ``loss`` the claim is a gain: an interval above 0 reproduces it, one below the effect of interest does not. With
    ``loss`` the claim is that less than the effect of interest is lost: an interval above that loss reproduces it, one below does
    not. Whatever else is undecided.

    Args:
        contrast: what is compared.
        found: None if it has not been run.
        hidden: why a floor or a ceiling hides the effect (:func:`hidden_effect`), which leaves it undecided.
    """
    if found is None:
        return Verdict.NOT_RUN
    if hidden:
        return Verdict.UNDECIDED
    least, most = (-contrast.interest, -contrast.interest) if contrast.loss else (0.0, contrast.interest)
    if found.low > least:
        return Verdict.FOUND if contrast.ours else Verdict.REPRODUCED
    if found.high < most:
        return Verdict.NOT_FOUND if contrast.ours else Verdict.NOT_REPRODUCED
    return Verdict.UNDECIDED


def hidden_effect(contrast: Contrast, found: Difference, first: float, other: float, most: float = 1.0) -> str:
    """Why a floor or a ceiling would hide the effect of interest; empty where neither does.

    An interval that lies wholly on the other side of 0 is never hidden: no ceiling makes a loss, no floor a gain.

    Args:
        contrast: of :attr:`Measure.SUCCESS` or :attr:`Measure.GOALS`.
        found: the difference.
        first: success rate of the first cell; of goals in a row the median.
        other: of the other cell.
        most: the largest possible.
    """
    few, many = f"too few {_COUNTED[contrast.measure]} to tell", f"too many {_COUNTED[contrast.measure]} to tell"
    if contrast.loss:
        return few if first < 2 * contrast.interest and found.low <= 0 else ""
    if max(first, other) < contrast.interest:
        return few
    at_the_cap = min(first, other) >= most if contrast.measure is Measure.GOALS else first > most - contrast.interest
    return many if at_the_cap and found.high >= 0 else ""


_COUNTED = {Measure.SUCCESS: "successes", Measure.GOALS: "goals"}


Outcomes = Sequence[Mapping[int, bool]]
"""Of each run (seed) of a cell whether it reached each goal, by the goal's seed."""
Robots = Sequence[Mapping[int, str]]
"""Of each run of a cell which robot tried each goal."""


def success_rate(runs: Outcomes) -> float:
    """Over all trials of all runs."""
    return sum(sum(run.values()) for run in runs) / sum(map(len, runs))


def hidden_success(contrast: Contrast, found: Difference, first: Outcomes, other: Outcomes) -> str:
    """:func:`hidden_effect` of paired trials."""
    return hidden_effect(contrast, found, success_rate(first), success_rate(other))


@dataclass(frozen=True)
class Observed:
    """What trials show of that which a power assumes.

    ``spread`` is the standard deviation of the runs' true differences: that of their differences with the chance of their trials
    taken off, at least 0; None for a single run. ``changing`` is the share of goals that the two sides end differently, None
    where only rates were kept, and ``first`` the success rate of the first cell.
    """

    spread: float | None
    changing: float | None
    first: float


def observed(first: Outcomes, other: Outcomes) -> Observed:
    """Of paired trials, run by run on the same goals.

    Args:
        first: of the first cell; at least one run has goals in common with its other.
        other: of the other cell.
    """
    sides = zip(first, other, strict=False)
    of_runs = [[int(after[goal]) - int(before[goal]) for goal in before if goal in after] for before, after in sides]
    changes = [each for each in of_runs if each]
    differences = [sum(each) / len(each) for each in changes]
    chance = [float(np.var(each)) / max(len(each) - 1, 1) for each in changes]
    changing = sum(map(abs, (change for each in changes for change in each))) / sum(map(len, changes))
    return Observed(true_spread(differences, chance), changing, success_rate(first))


def true_spread(differences: Sequence[float], chance: Sequence[float]) -> float | None:
    """Standard deviation of what lies behind differences that are each known up to a chance of this variance."""
    if len(differences) < 2:
        return None
    return math.sqrt(max(0.0, float(np.var(differences, ddof=1)) - float(np.mean(chance))))


def paired_success(first: Outcomes, other: Outcomes, robots: tuple[Robots, Robots] | None = None) -> Difference | None:
    """Difference of success rates on the same goals.

    Args:
        first: of the first cell.
        other: of the other cell, run by run.
        robots: of both cells, run by run; None where all robots are alike.

    Returns:
        None without a goal in common. With one run each Tango's interval of the paired difference, which speaks of these two
        policies only; with more the widest of that over all pairs, Student's over the runs' differences and Student's over the
        goals' mean differences, since all runs try the same goals. Where robots differ also Student's over the robots'
        differences, since both sides share a few robots: no chance of trials, trainings, goals or robots is left out. Nothing is
        added up: each goal is tried on one robot, so that robots' differences hold the chance of their goals and trials too.
    """
    gained = lost = pairs = 0
    of_runs: list[float] = []
    of_goals: dict[int, list[int]] = {}
    for before, after in zip(first, other, strict=False):
        common = {goal: int(after[goal]) - int(before[goal]) for goal in before if goal in after}
        if not common:
            continue
        changes = list(common.values())
        gained, lost, pairs = gained + changes.count(1), lost + changes.count(-1), pairs + len(changes)
        of_runs.append(sum(changes) / len(changes))
        for goal, change in common.items():
            of_goals.setdefault(goal, []).append(change)
    if not pairs:
        return None
    intervals = {Chance.TRIALS: paired_interval(gained, lost, pairs, LEVEL)}
    if len(of_runs) > 1:
        intervals |= {Chance.RUNS: _around(of_runs), Chance.GOALS: _around([sum(each) / len(each) for each in of_goals.values()])}
    shared = 0
    if robots is not None:
        rates = [_of_robots(*side, of_goals) for side in zip((first, other), robots, strict=True)]
        shared = len(rates[0].keys() & rates[1].keys())
        if len(rates[0].keys() | rates[1].keys()) > 1:
            intervals[Chance.ROBOTS] = _around([rates[1][robot] - rates[0][robot] for robot in rates[0] if robot in rates[1]])
    low, high, widest = _widest(intervals)
    return Difference((gained - lost) / pairs, low, high, pairs, len(of_runs), shared, widest)


def rate_interval(runs: Outcomes, robots: Robots | None = None) -> tuple[float, float]:
    """Interval of a success rate, of runs that tried the same goals: as wide as :func:`paired_success` has it.

    The widest of Wilson's over all trials, with more than one run Student's over the runs' and over the goals' rates, and where
    robots differ (``robots`` is not None) Student's over the robots' rates.
    """
    reached, trials = sum(sum(run.values()) for run in runs), sum(map(len, runs))
    goals = sorted(set().union(*runs))
    intervals = {Chance.TRIALS: wilson(reached, trials, LEVEL)}
    if len(runs) > 1:
        intervals[Chance.RUNS] = _around([sum(run.values()) / len(run) for run in runs])
        intervals[Chance.GOALS] = _around([float(np.mean([run[goal] for run in runs if goal in run])) for goal in goals])
    if robots is not None and len(rates := _of_robots(runs, robots, goals)) > 1:
        intervals[Chance.ROBOTS] = _around(list(rates.values()))
    low, high, _ = _widest(intervals)
    return max(0.0, low), min(1.0, high)


def _of_robots(runs: Outcomes, robots: Robots, goals: Collection[int]) -> dict[str, float]:
    """Success rate of each robot on these goals, over all runs; a trial counts for the robot that did it."""
    found: dict[str, list[bool]] = {}
    for run, did in zip(runs, robots, strict=True):
        for goal, reached in run.items():
            if goal in goals:
                found.setdefault(did[goal], []).append(reached)
    return {robot: sum(each) / len(each) for robot, each in found.items()}


def _around(values: Sequence[float]) -> tuple[float, float]:
    """Student's interval; infinitely wide for fewer than two values."""
    if len(values) < 2:
        return -math.inf, math.inf
    found = student(values)
    return found.low, found.high


def _widest(intervals: Mapping[Chance, tuple[float, float]]) -> tuple[float, float, tuple[Chance, Chance]]:
    """The lowest and the highest bound, and of which chance each is; of bounds that are equal that of the first."""
    below = min(intervals, key=lambda chance: intervals[chance][0])
    above = max(intervals, key=lambda chance: intervals[chance][1])
    return intervals[below][0], intervals[above][1], (below, above)


def student(values: Sequence[float], least_spread: float = 0.0) -> Difference:
    """Mean of a few values with Student's interval, of at least this spread; infinitely wide for a single one."""
    n, mean = len(values), float(np.mean(values))
    if n < 2:
        return Difference(mean, -math.inf, math.inf, n, n)
    spread = max(float(np.std(values, ddof=1)), least_spread)
    half = _quantile(n - 1) * spread / math.sqrt(n)
    return Difference(mean, mean - half, mean + half, n, n)


@cache
def _quantile(freedom: int) -> float:
    """Student's, of an interval's upper end."""
    return float(t.ppf((1 + LEVEL) / 2, freedom))


def paired_goals(first: Sequence[int], other: Sequence[int]) -> Difference:
    """Difference of goals in a row, trial by trial of the same seeds; each side is one policy.

    Differences that are all alike count as if one trial of them had been a goal away: some chance there always is. Each trial
    has a robot of its own, so that the chance of robots is that of trials.
    """
    differences = [after - before for before, after in zip(first, other, strict=True)]
    around = student(differences, least_spread=1 / math.sqrt(len(differences)))
    return Difference(around.estimate, around.low, around.high, len(differences), 1)


def arrival(evaluations: Sequence[Mapping], rate: float, budget: int, before: int = 0) -> Arrival:
    """When a run first reached a rate on nominal robots, as far as its evaluations tell.

    Args:
        evaluations: as they are kept, ``samples`` counted from the start of PPO.
        rate: that is to be reached.
        budget: samples of the run.
        before: samples that were taken before PPO began, those of demonstrations; they count.
    """
    after = before
    for each in sorted(evaluations, key=lambda each: each["samples"]):
        if each["physics"] != "nominal":
            continue
        seen = before + each["samples"]
        if each["success_rate"] >= rate:
            return Arrival(after, seen)
        after = seen
    return Arrival(before + budget, None)


def times_fewer(first: Sequence[Arrival], other: Sequence[Arrival]) -> Difference | None:
    """Log2 of how many times fewer samples the other cell's runs took, run by run.

    The bounds are Student's, the lower one of what each pair saved at least and the upper one of what it saved at most, since
    an arrival is known to lie between two evaluations only. A first run that never arrived opens the upper bound: its saving is
    larger than its budget shows, by nobody knows how much. Another's that never arrived opens the lower bound. Evaluations in
    training are on nominal robots, which are alike.
    """
    pairs = list(zip(first, other, strict=False))
    if not pairs:
        return None
    shown = student([math.log2(before.samples / after.samples) for before, after in pairs])
    least = [_log2(before.after, after.by) for before, after in pairs]
    most = [-_log2(after.after, before.by) for before, after in pairs]
    low = -math.inf if -math.inf in least else student(least).low
    high = math.inf if math.inf in most else student(most).high
    return Difference(shown.estimate, low, high, len(pairs), len(pairs), widest=(Chance.RUNS, Chance.RUNS))


def _log2(over: int, under: int | None) -> float:
    """Log2 of a quotient that may be as small as anything: of nothing, or by what has no end."""
    return -math.inf if over == 0 or under is None else math.log2(over / under)
