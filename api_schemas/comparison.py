"""Two or more jobs on the same goals: who did better, by how much, and could it be chance."""

import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from statistics import NormalDist
from typing import Literal

from pydantic import Field

from api_schemas.anytime import difference_sequence, is_decided, log_evidence, rate_sequence
from api_schemas.letters import compact_letters, holm, pair_chance
from api_schemas.recipe import FEWEST_SEEDS, crossed_interval
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
    interval_95: tuple[float, float]
    letters: str | None = Field(default=None, description="of three jobs or more: two that share one cannot be told apart")


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
    at_every_look: bool = Field(
        default=False, description="a question may have ended one of the jobs: intervals and p hold at every look"
    )

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


class ComparedRecipe(Schema):
    """The jobs of one recipe, a policy of each training seed: the mean of the seeds' rates, with intervals over seeds and goals.

    ``difference`` is what it did more than the first recipe; null for that one.
    """

    recipe: str
    jobs: tuple[str, ...]
    training_seeds: int
    success_rate: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]
    difference: float | None = None
    difference_80: tuple[float, float] | None = None
    difference_95: tuple[float, float] | None = None


class TaskComparison(Schema):
    """The jobs of one task; each is compared with the first."""

    task: str
    object: str
    object_scale: float
    goals: int
    jobs: tuple[ComparedJob, ...]
    differences: tuple[Difference, ...]
    per_goal: tuple[GoalRow, ...]
    recipes: tuple[ComparedRecipe, ...] = Field(default=(), description="of which at least two training seeds are compared")


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
        raise NotComparableError(f"the jobs have no goal in common ({seeds}); submit them with the same seed")
    goals = tuple(
        GoalRow(
            seed=seed,
            trials=tuple(rows[seed].trial for rows in of),
            robots=tuple(rows[seed].robot for rows in of),
            succeeded=tuple(rows[seed].outcome.kind == OutcomeKind.SUCCEEDED for rows in of),
        )
        for seed in common
    )
    letters = _letters(reports, goals)
    return TaskComparison(
        task=first.task,
        object=first.object,
        object_scale=first.object_scale,
        goals=len(goals),
        jobs=tuple(_job(report, goals, index, told) for (index, report), told in zip(enumerate(reports), letters, strict=True)),
        differences=tuple(_difference(reports, goals, index) for index in range(1, len(reports))),
        per_goal=goals,
        recipes=_recipes(reports, goals),
    )


def _recipes(reports: Sequence[Report], goals: Sequence[GoalRow]) -> tuple[ComparedRecipe, ...]:
    """The recipes that have several seeds among the jobs, in the order of their first jobs; of a seed its first job counts."""
    places: dict[str, dict[int, int]] = {}
    for place, report in enumerate(reports):
        if report.recipe is not None and report.training_seed is not None:
            places.setdefault(report.recipe, {}).setdefault(report.training_seed, place)
    several = {recipe: list(seeds.values()) for recipe, seeds in places.items() if len(seeds) >= FEWEST_SEEDS}
    ended = {recipe: [[goal.succeeded[at] for goal in goals] for at in seeds] for recipe, seeds in several.items()}
    first = next(iter(ended.values()), [])
    return tuple(
        _recipe(recipe, [reports[at].job_id for at in several[recipe]], seeds, None if seeds is first else first)
        for recipe, seeds in ended.items()
    )


def _recipe(
    recipe: str, jobs: Sequence[str], seeds: Sequence[Sequence[bool]], first: Sequence[Sequence[bool]] | None
) -> ComparedRecipe:
    nothing = [[False] * len(seeds[0])] * FEWEST_SEEDS
    rates = [sum(sum(ended) for ended in of_it) / len(of_it) / len(of_it[0]) for of_it in (seeds, first or seeds)]

    def interval(level: float) -> tuple[float, float]:
        low, high = crossed_interval(nothing, seeds, level)
        return max(0.0, low), min(1.0, high)

    return ComparedRecipe(
        recipe=recipe,
        jobs=tuple(jobs),
        training_seeds=len(seeds),
        success_rate=rates[0],
        interval_80=interval(0.80),
        interval_95=interval(0.95),
        difference=None if first is None else rates[0] - rates[1],
        difference_80=None if first is None else crossed_interval(first, seeds, 0.80),
        difference_95=None if first is None else crossed_interval(first, seeds, 0.95),
    )


def _letters(reports: Sequence[Report], goals: Sequence[GoalRow]) -> Sequence[str | None]:
    """Letters of three jobs or more, best first, with the chance of any false pair kept to ``CHANCE``.

    Pairs are told apart by McNemar's exact p and Holm's rule; where a question may have ended one of the jobs, by evidence that
    holds at every look, with Bonferroni's share of the chance.
    """
    count = len(reports)
    if count < 3:
        return [None] * count
    order = sorted(range(count), key=lambda index: -sum(goal.succeeded[index] for goal in goals))
    pairs = [(one, other) for one in range(count) for other in range(one)]
    counts = [_changed(goals, order[one], order[other]) for one, other in pairs]
    if any(report.intervals == "sequence" for report in reports):
        differ = [is_decided(gained, lost, pair_chance(count)) for gained, lost in counts]
    else:
        differ = holm([mcnemar(gained, lost) for gained, lost in counts])
    apart = [[False] * count for _ in range(count)]
    for (one, other), is_apart in zip(pairs, differ, strict=True):
        apart[one][other] = apart[other][one] = is_apart
    by_rank = compact_letters(apart)
    return [by_rank[order.index(index)] for index in range(count)]


def _changed(goals: Sequence[GoalRow], one: int, other: int) -> tuple[int, int]:
    """How many goals only the other reached, and how many only the one."""
    pairs = [(goal.succeeded[one], goal.succeeded[other]) for goal in goals]
    return pairs.count((False, True)), pairs.count((True, False))


def _job(report: Report, goals: Sequence[GoalRow], index: int, letters: str | None) -> ComparedJob:
    successes = sum(goal.succeeded[index] for goal in goals)
    interval = wilson if report.intervals == "wilson" else rate_sequence
    return ComparedJob(
        job_id=report.job_id,
        policy=report.policy,
        policy_name=report.policy_name,
        trials=len(goals),
        successes=successes,
        success_rate=successes / len(goals),
        interval_80=interval(successes, len(goals), 0.80),
        interval_95=interval(successes, len(goals), 0.95),
        letters=letters,
    )


def _difference(reports: Sequence[Report], goals: Sequence[GoalRow], index: int) -> Difference:
    pairs = [(goal.succeeded[0], goal.succeeded[index]) for goal in goals]
    gained, lost = pairs.count((False, True)), pairs.count((True, False))
    at_every_look = any(reports[each].intervals == "sequence" for each in (0, index))
    interval = difference_sequence if at_every_look else paired_interval
    return Difference(
        first=reports[0].job_id,
        other=reports[index].job_id,
        goals=len(goals),
        both=pairs.count((True, True)),
        neither=pairs.count((False, False)),
        gained=gained,
        lost=lost,
        difference=(gained - lost) / len(goals),
        interval_80=interval(gained, lost, len(goals), 0.80),
        interval_95=interval(gained, lost, len(goals), 0.95),
        p=math.exp(min(0.0, -log_evidence(gained, lost))) if at_every_look else mcnemar(gained, lost),
        at_every_look=at_every_look,
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
