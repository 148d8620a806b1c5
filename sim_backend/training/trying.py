"""Tries a policy on many goals at once, on robots of several kinds, and says how sure its success rate is."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.stats import binomtest

from api_schemas.policy import PolicyManifest
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.evaluation import Act, evaluate
from sim_backend.tasks.task import Task
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class Tried:
    """Success at the end of n trials; ``interval_80`` is Wilson's."""

    physics: str
    trials: int
    first_seed: int
    physics_step_s: float
    successes: int
    success_rate: float
    interval_80: tuple[float, float]
    mean_position_error_m: float

    def document(self) -> dict:
        """As JSON has it."""
        return asdict(self) | {"interval_80": list(self.interval_80)}


def robots_of(physics: str, trials: int, seed: int) -> Physics:
    """A robot for each trial: of a preset, of a file, or nominal ones with some values changed (``effect.parameter=0.5,...``).

    Raises:
        ValueError: there is no such preset, file or parameter.
    """
    if "=" in physics:
        pairs = (entry.partition("=") for entry in physics.split(","))
        return Physics.of(trials, {key.strip(): float(value) for key, _, value in pairs})
    ranges, rng = load_ranges(physics), np.random.default_rng(seed)
    return ranges.draw_episode(rng, ranges.draw(rng, trials))


def try_policy(
    act: Act,
    manifest: PolicyManifest,
    task: Task,
    seeds: Sequence[int],
    physics: str,
    *,
    threads: int = 2,
    physics_step_s: float = c.PHYSICS_STEP_S,
) -> tuple[Tried, np.ndarray]:
    """Try the goals of the seeds; returns the summary and the success of each trial, shape (n,)."""
    robots = robots_of(physics, len(seeds), seeds[0])
    found = evaluate(act, manifest, task, seeds, physics=robots, threads=threads, physics_step_s=physics_step_s)
    successes = int(found.success.sum())
    interval = binomtest(successes, len(seeds)).proportion_ci(0.8, method="wilson")
    error_m = float(np.mean(found.position_error_m))
    rate, limits = successes / len(seeds), (float(interval.low), float(interval.high))
    return Tried(physics, len(seeds), seeds[0], physics_step_s, successes, rate, limits, error_m), found.success
