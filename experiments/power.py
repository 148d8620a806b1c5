"""What a design can show, told before it runs: the judge itself on made-up trials, drawn with a fixed seed."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from experiments.design import Contrast, Measure
from experiments.judging import Arrival, Verdict, paired_success, times_fewer, verdict

REPETITIONS = 200
SEED = 1
CHANGING_SIDES = 0.3
"""Share of goals that two policies end differently; each goal of each run by itself. An assumption."""
SPREAD = 0.1
"""Standard deviation of the true differences of single runs around their mean, where trainings differ. An assumption."""


SPREAD_OF_ARRIVALS = 0.5
"""Standard deviation of the log2 of the samples that single runs of a cell take to a rate. An assumption."""


@dataclass(frozen=True)
class Design:
    """Paired trials of so many runs a cell on so many goals each, judged by this effect of interest.

    ``robots`` is on how many that differ the goals are tried, in turns; 0 where they are alike. The judge allows for gains that
    differ between them; the made-up ones do not.
    """

    runs: int
    goals: int
    interest: float
    loss: bool = False
    robots: int = 0


@cache
def power(design: Design, truth: float, spread: float) -> float:
    """Share of repetitions that read as reproduced.

    Args:
        design: what is tried and how it is judged.
        truth: the mean true difference of success rates.
        spread: standard deviation of the runs' true differences around it.
    """
    rng = np.random.default_rng(SEED)
    contrast = Contrast("", Measure.SUCCESS, "", "", design.interest, loss=design.loss)
    turns = [{goal: f"robot-{goal % design.robots}" for goal in range(design.goals)} if design.robots else {}] * design.runs
    robots = (turns, turns) if design.robots else None
    said = [verdict(contrast, paired_success(*_trials(design, truth, spread, rng), robots)) for _ in range(REPETITIONS)]
    return said.count(Verdict.REPRODUCED) / REPETITIONS


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
        difference = float(np.clip(truth + spread * rng.standard_normal(), -1, 1))
        changing = max(CHANGING_SIDES, abs(difference))
        gained, lost = (changing + difference) / 2, (changing - difference) / 2
        drawn = rng.random(design.goals)
        first.append({goal: bool(gained <= each < gained + lost) for goal, each in enumerate(drawn)})
        other.append({goal: bool(each < gained) for goal, each in enumerate(drawn)})
    return first, other
