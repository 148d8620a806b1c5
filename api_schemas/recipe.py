"""A recipe is a training that was done with several seeds: how good it is, with an interval over seeds.

Policies of one recipe differ, and trials of one policy say nothing of the next: with three seeds of 1,000 trials each one knows
three numbers. The interval is Student's of the seeds' success rates, which holds what differs between seeds and what is chance in
their trials. Seeds that all ended alike would make it a point, so that it is never narrower than that of all trials together.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Annotated

from pydantic import Field

from api_schemas.anytime import rate_sequence
from api_schemas.success_rate import wilson

BISECTIONS = 60
FEWEST_SEEDS = 2
"""With one seed nothing is known of the others."""
RecipeName = Annotated[str, Field(min_length=1, max_length=100, description="a training; its policies differ by the seed")]
Counts = tuple[int, int]
"""Successes and trials of one training seed."""


def seeds_interval(of_seeds: Sequence[Counts], level: float, *, at_every_look: bool = False) -> tuple[float, float]:
    """The interval of a recipe's mean success rate from its seeds, each tried on goals of its own, as fractions.

    Args:
        of_seeds: at least ``FEWEST_SEEDS``, each with a trial.
        level: of the interval.
        at_every_look: take the confidence sequence of all trials for the narrowest that it may be. The part over seeds is for a
            number of seeds that was fixed before.
    """
    rates = [successes / trials for successes, trials in of_seeds]
    mean = sum(rates) / len(rates)
    half = t_quantile((1 + level) / 2, len(rates) - 1) * math.sqrt(variance(rates) / len(rates))
    successes, trials = (sum(each) for each in zip(*of_seeds, strict=True))
    low, high = (rate_sequence if at_every_look else wilson)(successes, trials, level)
    return max(0.0, min(low, mean - half)), min(1.0, max(high, mean + half))


def crossed_interval(one: Sequence[Sequence[bool]], other: Sequence[Sequence[bool]], level: float) -> tuple[float, float]:
    """The interval of ``other``'s mean success rate minus ``one``'s, where all seeds of both tried the same goals.

    Seeds of both and goals are drawn; the variances of the three means add up (the seeds' also hold their trials' chance, so that
    it is on the safe side), with the degrees of freedom of Welch and Satterthwaite, rounded down. Goals on which nothing differed
    still leave what Tango's interval leaves of them.

    Args:
        one: for each seed how it ended on each goal; at least ``FEWEST_SEEDS``.
        other: the same of the other recipe.
        level: of the interval.
    """
    rates = [[sum(ended) / len(ended) for ended in seeds] for seeds in (one, other)]
    goals = [_mean(after) - _mean(before) for before, after in zip(zip(*one, strict=True), zip(*other, strict=True), strict=True)]
    parts = [(variance(values) / len(values), len(values) - 1) for values in (*rates, goals) if len(values) > 1]
    whole = sum(part for part, _ in parts)
    spread = sum(part**2 / freedom for part, freedom in parts)
    middle = _mean(rates[1]) - _mean(rates[0])
    freedom = max(1, int(whole**2 / spread)) if spread else 1
    square = NormalDist().inv_cdf((1 + level) / 2) ** 2
    half = max(t_quantile((1 + level) / 2, freedom) * math.sqrt(whole), square / (len(goals) + square))
    return max(-1.0, middle - half), min(1.0, middle + half)


def variance(values: Sequence[float]) -> float:
    """Of a sample, unbiased."""
    mean = _mean(values)
    return sum((value - mean) ** 2 for value in values) / (len(values) - 1)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def t_quantile(share: float, freedom: int) -> float:
    """Student's t below which the share of the law lies, at least a half; ``freedom`` is a whole number."""
    low, high = 0.0, 1.0
    while t_share(high, freedom) < share:
        high *= 2
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if t_share(middle, freedom) < share else (low, middle)
    return high


def t_share(t: float, freedom: int) -> float:
    """The share of Student's law below ``t``, which is not negative (Abramowitz and Stegun, 26.7.3 and 26.7.4)."""
    angle = math.atan2(t, math.sqrt(freedom))
    sine, square = math.sin(angle), math.cos(angle) ** 2
    first = 1 if freedom % 2 else 0
    term = math.cos(angle) if first else 1.0
    total = 0.0
    for place in range(first, freedom - 1, 2):
        total += term
        term *= square * (place + 1) / (place + 2)
    within = 2 / math.pi * (angle + sine * total) if first else sine * total
    return (1 + within) / 2
