"""What a design can show, told before it runs: the judge itself on made-up trials, drawn with a fixed seed."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from experiments.design import Contrast, Measure
from experiments.judging import (
    Arrival,
    Difference,
    Observed,
    Outcomes,
    Robots,
    Verdict,
    hidden_success,
    paired_success,
    times_fewer,
    verdict,
)

REPETITIONS = 200
SEED = 1
CHANGING_SIDES = 0.3
"""Share of goals that two policies end differently; each goal of each run by itself. An assumption where nothing was measured."""
FIRST = 0.5
"""Success rate of the first cell. An assumption where nothing was measured."""
SPREAD = 0.1
"""Standard deviation of the true differences of single runs around their mean, where trainings differ; as assumed at first."""
SPREADS = (0.0, SPREAD, 0.2)
"""For which power is told, beside those that were measured."""
SPREAD_OF_ARRIVALS = 0.5
"""Standard deviation of the log2 of the samples that single runs of a cell take to a rate. An assumption."""


@dataclass(frozen=True)
class Design:
    """Paired trials of so many runs a cell on so many goals each, judged by this effect of interest.

    ``robots`` is on how many that differ the goals are tried, in turns; 0 where they are alike. The judge allows for gains that
    differ between them; the made-up ones do not. ``first`` is how often the first cell succeeds, and ``changing`` the share of
    goals that the other ends differently, both as probabilities; fewer change sides where the rates leave no room for so many.
    """

    runs: int
    goals: int
    interest: float
    loss: bool = False
    robots: int = 0
    first: float = FIRST
    changing: float = CHANGING_SIDES

    @property
    def of_interest(self) -> float:
        """The true difference for which power counts: the gain of interest, or that nothing is lost."""
        return 0.0 if self.loss else self.interest


@cache
def power(design: Design, truth: float, spread: float) -> float:
    """Share of repetitions that read as reproduced, by the whole rule: also what a floor or a ceiling hides is undecided.

    Args:
        design: what is tried and how it is judged.
        truth: the mean true difference of success rates.
        spread: standard deviation of the runs' true differences around it.
    """
    rng = np.random.default_rng(SEED)
    contrast = Contrast("", Measure.SUCCESS, "", "", design.interest, loss=design.loss)
    turns = [{goal: f"robot-{goal % design.robots}" for goal in range(design.goals)} if design.robots else {}] * design.runs
    robots = (turns, turns) if design.robots else None
    said = [_said(contrast, *_trials(design, truth, spread, rng), robots) for _ in range(REPETITIONS)]
    return said.count(Verdict.REPRODUCED) / REPETITIONS


def _said(contrast: Contrast, first: Outcomes, other: Outcomes, robots: tuple[Robots, Robots] | None) -> Verdict:
    found = paired_success(first, other, robots)
    assert found is not None
    return verdict(contrast, found, hidden_success(contrast, found, first, other))


def power_as_observed(contrast: Contrast, found: Difference, shown: Observed) -> float:
    """What a contrast could show of the effect of interest, its trainings spreading and goals changing sides as they did."""
    design = Design(found.runs, found.n // found.runs, contrast.interest, contrast.loss, found.robots, shown.first)
    design = design if shown.changing is None else replace(design, changing=shown.changing)
    return power(design, design.of_interest, shown.spread or 0.0)


@cache
def power_of_arrivals(runs: int, interest: float, truth: float) -> float:
    """Share of repetitions that read as reproduced where samples to a rate are compared.

    Args:
        runs: of each cell; all arrive.
        interest: log2 of how many times fewer.
        truth: its true mean.
    """
    rng = np.random.default_rng(SEED)
    contrast = Contrast("", Measure.SAMPLES_TO, "", "", interest)
    said = [verdict(contrast, times_fewer(_arrived(runs, truth, rng), _arrived(runs, 0.0, rng))) for _ in range(REPETITIONS)]
    return said.count(Verdict.REPRODUCED) / REPETITIONS


def _arrived(runs: int, log2_samples: float, rng: np.random.Generator) -> list[Arrival]:
    """Runs of a cell, whose samples are a million times this in the mean, each evaluated often enough."""
    took = 1e6 * 2.0 ** (log2_samples + SPREAD_OF_ARRIVALS * rng.standard_normal(runs))
    return [Arrival(int(each), int(each)) for each in took]


def _trials(design: Design, truth: float, spread: float, rng: np.random.Generator) -> tuple[list[dict], list[dict]]:
    """Whether each goal was reached, run by run, of the first cell and of the other."""
    first, other = [], []
    for _ in range(design.runs):
        difference = float(np.clip(truth + spread * rng.standard_normal(), -design.first, 1 - design.first))
        room = min(2 * design.first + difference, 2 * (1 - design.first) - difference)
        changing = max(min(design.changing, room), abs(difference))
        gained = (changing + difference) / 2
        successes = changing + design.first - (changing - difference) / 2
        drawn = rng.random(design.goals)
        first.append(_by_goal((gained <= drawn) & (drawn < successes)))
        other.append(_by_goal((drawn < gained) | ((changing <= drawn) & (drawn < successes))))
    return first, other


def _by_goal(reached: np.ndarray) -> dict[int, bool]:
    return dict(enumerate(reached.tolist()))
