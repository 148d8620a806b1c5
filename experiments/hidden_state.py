"""What the state of a memory knows of its robot: ridge regression, judged on robots that it was not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.design import HiddenState
from sim_backend.evaluation import begin_trials
from sim_backend.tasks.task import Task
from sim_backend.training.export import ExportedPolicy
from sim_backend.training.trying import robots_of

PENALTIES = (0.1, 1.0, 10.0, 100.0, 1000.0)
FOLDS = 5
RESAMPLES = 1000


@dataclass(frozen=True)
class Known:
    """How well something is predicted on held-out robots: R2 of the state and of the observation of the same instant.

    The interval (80 %, robots drawn again) is that of their difference: what the memory knows beyond what is seen.
    """

    of_state: float
    of_observation: float
    difference: float
    low: float
    high: float
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
    squares = [(target[held] - _predicted(x, target, fitted, held)) ** 2 for x in (state, observation)]
    whole = (target[held] - target[fitted].mean()) ** 2
    values = [_gain(squares, whole, rng.integers(len(held), size=len(held))) for _ in range(RESAMPLES)]
    of_state, of_observation = (1 - each.sum() / whole.sum() for each in squares)
    low, high = np.quantile(values, [0.1, 0.9])
    return Known(of_state, of_observation, of_state - of_observation, float(low), float(high), len(held))


def _gain(squares: Sequence[np.ndarray], whole: np.ndarray, rows: np.ndarray) -> float:
    of_state, of_observation = (each[rows].sum() / whole[rows].sum() for each in squares)
    return of_observation - of_state


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


def ask(policy: ExportedPolicy, task: Task, design: HiddenState, *, threads: int = 1) -> dict:
    """Let a policy with a memory drive robots of ``real`` and ask its state what they are, as JSON has it."""
    seeds = range(design.first_seed, design.first_seed + design.robots)
    robots = robots_of("real", design.robots, design.first_seed)
    episode, _ = begin_trials(policy.manifest, task, seeds, physics=robots, threads=threads, physics_step_s=0.004)
    policy.begin(design.robots)
    found: dict[str, list] = {parameter: [] for parameter in design.parameters}
    periods = 0
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
