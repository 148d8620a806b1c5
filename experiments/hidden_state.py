"""What the state of a memory knows of its robot: ridge regression, judged on robots that it was not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from experiments.design import HiddenState
from sim_backend.evaluation import begin_trials
from sim_backend.tasks.task import Task

if TYPE_CHECKING:
    from sim_backend.training.export import ExportedPolicy

PENALTIES = (0.1, 1.0, 10.0, 100.0, 1000.0)
FOLDS = 5
RESAMPLES = 1000


@dataclass(frozen=True)
class Known:
    """How well something is predicted on held-out robots: R2 of the state, of the observation of the same instant, of both.

    ``difference`` is what the memory knows beyond what is seen: R2 of both above that of the observation, or above 0 where the
    observation predicts worse than the mean does; ``low`` and ``high`` are its interval (80 %, robots drawn again).
    ``told_by_state`` and ``told_by_observation`` are the shares of robots of which it is told rightly whether they are above or
    below the mean.
    """

    of_state: float
    of_observation: float
    of_both: float
    difference: float
    low: float
    high: float
    told_by_state: float
    told_by_observation: float
    robots: int


def known(state: np.ndarray, observation: np.ndarray, target: np.ndarray, rng: np.random.Generator) -> Known:
    """Fit on a half of the robots, judge on the other.

    Args:
        state: shape (robots, cells).
        observation: shape (robots, numbers).
        target: shape (robots,), what is to be predicted.
        rng: draws halves and resamples.
    """
    order = rng.permutation(len(target))
    fitted, held = order[: len(order) // 2], order[len(order) // 2 :]
    mean = target[fitted].mean()
    guesses = [_predicted(x, target, fitted, held) for x in (state, observation, np.column_stack([observation, state]))]
    squares = [(target[held] - guess) ** 2 for guess in guesses]
    whole = (target[held] - mean) ** 2
    values = [_gain(squares, whole, rng.integers(len(held), size=len(held))) for _ in range(RESAMPLES)]
    of_state, of_observation, of_both = (float(1 - each.sum() / whole.sum()) for each in squares)
    told = [float(np.mean((guess > mean) == (target[held] > mean))) for guess in guesses]
    low, high = (float(each) for each in np.quantile(values, [0.1, 0.9]))
    difference = _gain(squares, whole, np.arange(len(held)))
    return Known(of_state, of_observation, of_both, difference, low, high, told[0], told[1], len(held))


def _gain(squares: Sequence[np.ndarray], whole: np.ndarray, rows: np.ndarray) -> float:
    _, of_observation, of_both = (1 - each[rows].sum() / whole[rows].sum() for each in squares)
    return float(of_both - max(of_observation, 0.0))


def _predicted(x: np.ndarray, target: np.ndarray, fitted: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Ridge regression with the penalty that predicts best within the fitted robots."""
    centre, spread = x[fitted].mean(axis=0), x[fitted].std(axis=0)
    scaled = (x - centre) / np.where(spread > 1e-9, spread, 1.0)
    folds = np.arange(len(fitted)) % FOLDS
    errors = []
    for penalty in PENALTIES:
        missed = 0.0
        for fold in range(FOLDS):
            rest, out = fitted[folds != fold], fitted[folds == fold]
            missed += float(((target[out] - _ridge(scaled, target, rest, out, penalty)) ** 2).sum())
        errors.append(missed)
    return _ridge(scaled, target, fitted, held, PENALTIES[int(np.argmin(errors))])


def _ridge(x: np.ndarray, target: np.ndarray, fitted: np.ndarray, wanted: np.ndarray, penalty: float) -> np.ndarray:
    mean = target[fitted].mean()
    a = x[fitted]
    weights = np.linalg.solve(a.T @ a + penalty * np.eye(x.shape[1]), a.T @ (target[fitted] - mean))
    return x[wanted] @ weights + mean


def ask(policy: "ExportedPolicy", task: Task, design: HiddenState, *, threads: int = 1) -> dict:
    """Let a policy with a memory drive robots of ``real`` and ask its state what they are, as JSON has it."""
    from sim_backend.training.trying import robots_of

    seeds = range(design.first_seed, design.first_seed + design.robots)
    robots = robots_of("real", design.robots, design.first_seed)
    episode, _ = begin_trials(policy.manifest, task, seeds, physics=robots, threads=threads, physics_step_s=0.004)
    policy.begin(design.robots)
    found: dict[str, list] = {parameter: [] for parameter in design.parameters}
    periods, seen = 0, np.zeros((design.robots, policy.manifest.observation_size), np.float32)
    for at_s in sorted(design.at_s):
        while periods < round(at_s * policy.manifest.rate_hz):
            seen = episode.observe().astype(np.float32)
            action = policy(seen)
            episode.advance(np.asarray(action, dtype=float))
            periods += 1
        state = policy.remembered
        if state is None:
            raise ValueError(f"{policy.manifest.name} has no memory to ask")
        for parameter, asked in found.items():
            target = np.asarray(robots.value(parameter), dtype=float).reshape(design.robots, -1).mean(axis=1)
            asked.append({"at_s": at_s} | vars(known(state, seen, target, np.random.default_rng(design.first_seed))))
    return {"robots": design.robots, "task": task.name, "parameters": found}
