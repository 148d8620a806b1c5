"""What a design can show, told before it runs: the judge itself on made-up trials, drawn with a fixed seed."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from experiments.design import Contrast, Measure
from experiments.judging import Verdict, paired_success, verdict

REPETITIONS = 200
SEED = 1
CHANGING_SIDES = 0.3
"""Share of goals that two policies end differently; each goal of each run by itself. An assumption."""
SPREAD = 0.1
"""Standard deviation of the true differences of single runs around their mean, where trainings differ. An assumption."""


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
