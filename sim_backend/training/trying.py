"""Tries a policy on many goals at once, on robots of several kinds, and says how sure its success rate is.

    python -m sim_backend.training.trying POLICY.safetensors --task push [--trials 200] [--first-seed N] [--physics P ...]
        [--against OTHER.safetensors] [--out FILE]

``P`` is a preset, a file, or values of otherwise nominal robots, as in ``table_friction.coefficient=0.5,cube_mass.factor=1.2``.
With ``--against`` the other policy tries the same goals on the same robots, and the difference is taken goal by goal.
``builtin:grasp`` or ``builtin:grasp-turn`` instead of a file is a controller that needs no weights.
"""

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from safetensors import SafetensorError

from api_schemas.builtin_policies import builtin_manifest
from api_schemas.policy import PolicyManifest
from api_schemas.success_rate import wilson
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.evaluation import Act, evaluate
from sim_backend.grasping.controller import GraspPolicy
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import Task
from sim_backend.trifinger import constants as c

if TYPE_CHECKING:
    from sim_backend.training.export import ExportedPolicy

LESS_FRICTION = "fingertip_friction.coefficient=0.5,table_friction.coefficient=0.5"
"""Half the nominal friction in all contacts of the cube."""


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
    error_m = float(np.mean(found.position_error_m))
    rate, limits = successes / len(seeds), wilson(successes, len(seeds), 0.8)
    return Tried(physics, len(seeds), seeds[0], physics_step_s, successes, rate, limits, error_m), found.success


def difference(first: np.ndarray, second: np.ndarray) -> dict:
    """How much more often the first policy succeeded, goal by goal, with an 80 % interval (normal); arguments bool (n,)."""
    apart = first.astype(float) - second.astype(float)
    half = NormalDist().inv_cdf(0.9) * apart.std(ddof=1) / np.sqrt(len(apart))
    mean = float(apart.mean())
    return {"trials": len(apart), "difference": mean, "interval_80": [mean - float(half), mean + float(half)]}


def compare(policies: Sequence[Path], task: str, seeds: range, kinds: Sequence[str], threads: int) -> dict:
    """Every policy on every kind of robot, as JSON has it; of two policies also the difference."""
    found: dict = {"task": task, "tried": [], "differences": []}
    for physics in kinds:
        outcomes = []
        for path in policies:
            policy = _read(path)
            tried, success = try_policy(policy, policy.manifest, TASKS[task], seeds, physics, threads=threads)
            found["tried"].append({"policy": path.name} | tried.document())
            outcomes.append(success)
        if len(outcomes) == 2:
            names = {"physics": physics, "policy": policies[0].name, "against": policies[1].name}
            found["differences"].append(names | difference(*outcomes))
    return found


def _read(path: Path) -> "ExportedPolicy | GraspPolicy":
    """A policy's file, or a controller by its name."""
    from sim_backend.training.export import read_policy

    builtin = builtin_manifest(str(path))
    return read_policy(path) if builtin is None else GraspPolicy(builtin)


def _check(given: argparse.Namespace) -> None:
    """See that all can be tried, before anything is.

    Raises:
        ValueError: what cannot; the message says why.
    """
    least = 2 if given.against else 1
    if given.trials < least:
        raise ValueError(f"--trials is {given.trials}; ask for at least {least}{', since differences vary' * (least - 1)}")
    if given.out and not given.out.parent.is_dir():
        raise ValueError(f"there is no folder {given.out.parent} for --out; make it first")
    for physics in given.physics:
        robots_of(physics, 1, 0)
    for path in filter(None, (given.policy, given.against)):
        try:
            _read(path)
        except SafetensorError as error:
            raise ValueError(f"{path} is not a safetensors file: {error}") from error


def main(arguments: list[str] | None = None) -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Try a policy on many goals.")
    parser.add_argument("policy", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--task", required=True, choices=list(TASKS))
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=30_000_000)
    parser.add_argument("--physics", nargs="+", default=["nominal", LESS_FRICTION, "real"])
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    try:
        _check(given)
    except ValueError as error:
        parser.error(str(error))
    seeds = range(given.first_seed, given.first_seed + given.trials)
    policies = [given.policy, *([given.against] if given.against else [])]
    text = json.dumps(compare(policies, given.task, seeds, given.physics, given.threads), indent=2)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
