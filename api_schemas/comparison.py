"""Two or more jobs on the same goals: who did better, by how much, and could it be chance."""

import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from statistics import NormalDist
from typing import Literal

from pydantic import Field

from api_schemas.report import Report
from api_schemas.scene_form import form_or_first, told_forms
from api_schemas.schema import Schema
from api_schemas.success_rate import wilson
from api_schemas.trial import OutcomeKind

CHANCE = 0.05
"""A difference counts as one when chance alone would show it, or a larger one, at most so often."""
BISECTIONS = 60


class ComparedJob(Schema):
    """One job, counted over the goals that all compared jobs tried."""

    job_id: str
    policy: str
    policy_name: str
    trials: int
    successes: int
    success_rate: float
    interval_80: tuple[float, float]


class Difference(Schema):
    """What ``other`` did more than ``first`` on the same goals; rates are fractions, ``p`` is McNemar's, exact and two-sided."""

    first: str
    other: str
    goals: int
    both: int
    neither: int
    gained: int = Field(description="goals that only ``other`` reached")
    lost: int = Field(description="goals that only ``first`` reached")
    difference: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]
    p: float

    @property
    def is_worse(self) -> bool:
        """Whether ``other`` is worse, and chance alone would hardly show that."""
        return self.lost > self.gained and self.p <= CHANCE


class GoalRow(Schema):
    """One goal and how each job's trial of it ended, in the order of the jobs."""

    seed: int
    trials: tuple[int, ...]
    robots: tuple[str, ...]
    succeeded: tuple[bool, ...]


class TaskComparison(Schema):
    """The jobs of one task; each is compared with the first."""

    task: str
    object: str
    object_scale: float
    goals: int
    jobs: tuple[ComparedJob, ...]
    differences: tuple[Difference, ...]
    per_goal: tuple[GoalRow, ...]


class Comparison(Schema):
    """All jobs that were compared, by task."""

    format: Literal["trifarm-comparison/1"] = "trifarm-comparison/1"
    tasks: tuple[TaskComparison, ...]


class NotComparableError(Exception):
    """The jobs did not try the same goals in the same form of the scene; the message says which and what to do."""


def compare(reports: Sequence[Report]) -> Comparison:
    """Compares jobs task by task, in the order in which they are given.

    Raises:
        NotComparableError: there are fewer than two jobs of a task, they have no goal in common, or they were done with different
            forms of the scene.
    """
    kinds = list(dict.fromkeys(_kind(report) for report in reports))
    ordered = sorted(reports, key=lambda report: kinds.index(_kind(report)))
    return Comparison(tasks=tuple(_task(list(group)) for _, group in groupby(ordered, key=_kind)))


def _kind(report: Report) -> tuple[str, str, float]:
    return report.task, report.object, report.object_scale


def _task(reports: Sequence[Report]) -> TaskComparison:
    first = reports[0]
    if len(reports) < 2:
        raise NotComparableError(
            f"job {first.job_id} is the only one of {first.task} with {first.object}; a comparison needs two of the same task"
        )
    if len({report.job_id for report in reports}) < len(reports):
        raise NotComparableError(f"job {first.job_id} is named twice or more; name each job once")
    forms = {form_or_first(form) for report in reports for form in report.forms or (None,)}
    if len(forms) > 1:
        told = "; ".join(f"{report.job_id}: {told_forms(report.forms)}" for report in reports)
        raise NotComparableError(f"the jobs were done with different forms of the scene, which changes what a goal asks ({told})")
    of = [{row.seed: row for row in report.per_trial} for report in reports]
    common = [seed for seed in of[0] if all(seed in rows for rows in of)]
    if not common:
        seeds = ", ".join(f"{report.job_id} has seed {report.seed}" for report in reports)
        raise NotComparableError(f"the jobs have no goal in common ({seeds}); submit them with the same --seed")
    goals = tuple(
        GoalRow(
            seed=seed,
            trials=tuple(rows[seed].trial for rows in of),
            robots=tuple(rows[seed].robot for rows in of),
            succeeded=tuple(rows[seed].outcome.kind == OutcomeKind.SUCCEEDED for rows in of),
        )
        for seed in common
    )
    return TaskComparison(
        task=first.task,
        object=first.object,
        object_scale=first.object_scale,
        goals=len(goals),
        jobs=tuple(_job(report, goals, index) for index, report in enumerate(reports)),
        differences=tuple(_difference(reports, goals, index) for index in range(1, len(reports))),
        per_goal=goals,
    )


def _job(report: Report, goals: Sequence[GoalRow], index: int) -> ComparedJob:
    successes = sum(goal.succeeded[index] for goal in goals)
    return ComparedJob(
        job_id=report.job_id,
        policy=report.policy,
        policy_name=report.policy_name,
        trials=len(goals),
        successes=successes,
        success_rate=successes / len(goals),
        interval_80=wilson(successes, len(goals), 0.80),
    )


def _difference(reports: Sequence[Report], goals: Sequence[GoalRow], index: int) -> Difference:
    pairs = [(goal.succeeded[0], goal.succeeded[index]) for goal in goals]
    gained, lost = pairs.count((False, True)), pairs.count((True, False))
    return Difference(
        first=reports[0].job_id,
        other=reports[index].job_id,
        goals=len(goals),
        both=pairs.count((True, True)),
        neither=pairs.count((False, False)),
        gained=gained,
        lost=lost,
        difference=(gained - lost) / len(goals),
        interval_80=paired_interval(gained, lost, len(goals), 0.80),
        interval_95=paired_interval(gained, lost, len(goals), 0.95),
        p=mcnemar(gained, lost),
    )


def changed_sides(task: TaskComparison, index: int) -> Iterable[GoalRow]:
    """The goals that the job of this index ended otherwise than the first one did."""
    return (goal for goal in task.per_goal if goal.succeeded[0] != goal.succeeded[index])


def mcnemar(gained: int, lost: int) -> float:
    """The exact two-sided p of McNemar's test: are as many goals gained as lost, but for chance?

    Source: Q. McNemar, Psychometrika 12 (1947) 153; exact as the binomial test of the goals that changed sides.
    """
    changed = gained + lost
    tail = sum(math.comb(changed, k) for k in range(min(gained, lost) + 1))
    return min(1.0, 2 * tail / 2**changed)


def paired_interval(gained: int, lost: int, goals: int, level: float) -> tuple[float, float]:
    """Tango's score interval of the difference of two paired rates, (gained - lost) / goals.

    It holds its level also for few goals and for rates near 0 and 1. Source: T. Tango, Stat. Med. 17 (1998) 891.
    """
    z = NormalDist().inv_cdf((1 + level) / 2)
    return _bound(gained, lost, goals, z), _bound(gained, lost, goals, -z)


def _bound(gained: int, lost: int, goals: int, z: float) -> float:
    """The difference at which the score is ``z``; the score falls while the difference grows."""
    low, high = -1.0, 1.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if _score(gained, lost, goals, middle) > z else (low, middle)
    return (low + high) / 2


def _score(gained: int, lost: int, goals: int, difference: float) -> float:
    a = 2 * goals
    b = -gained - lost + (2 * goals - gained + lost) * difference
    c = -lost * difference * (1 - difference)
    likeliest_lost = (math.sqrt(max(0.0, b * b - 4 * a * c)) - b) / (2 * a)
    variance = goals * (2 * likeliest_lost + difference * (1 - difference))
    away = gained - lost - goals * difference
    if away == 0:
        return 0.0
    return math.copysign(math.inf, away) if variance <= 1e-15 else away / math.sqrt(variance)
