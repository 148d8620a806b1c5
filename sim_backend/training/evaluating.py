"""What every run tries and writes, whatever it learns by: its policy on kept goals while it trains, on fresh ones at the end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from sim_backend.tasks import TASKS
from sim_backend.training.export import ExportedPolicy, write_policy
from sim_backend.training.folder import RECORD
from sim_backend.training.trying import Tried, robots_of, try_policy

EVALUATION_SEED, FINAL_SEED = 10_000_000, 20_000_000
"""First seeds of the goals of evaluations; training draws its own from 2**53."""
TELL_EVERY_S = 10.0


class Learning(Protocol):
    """A run: its recipe says the task and the evaluations."""

    name: str
    recipe: Any
    folder: Path
    threads: int
    tell: Callable[[str], None]
    evaluations: list[dict]

    def exported(self) -> ExportedPolicy:
        """The policy as the farm takes it."""
        ...

    def record(self) -> dict:
        """What the run has done so far."""
        ...


def check_robots(recipe: Any) -> None:
    """Look up the robots of all evaluations before anything is learned: the first one is millions of samples away.

    Raises:
        ValueError: some ``evaluation.physics`` is no preset, file or parameter; the message says which.
    """
    for physics in recipe.evaluation.physics:
        try:
            robots_of(physics, 1, 0)
        except ValueError as error:
            raise ValueError(f"evaluation.physics {physics!r}: {error}") from error


def evaluate(run: Learning, samples: int) -> list[Tried]:
    """Try the policy as it is, on the goals that all evaluations of a run have, and tell what came of it."""
    first = EVALUATION_SEED
    found = _tried(run, range(first, first + run.recipe.evaluation.trials), physics_step_s=0.004)
    for tried in found:
        run.evaluations.append({"samples": samples} | tried.document())
        low, high = tried.interval_80
        rate = f"{tried.success_rate:.0%} (80 % interval {low:.0%} to {high:.0%}) of {tried.trials} goals"
        run.tell(f"evaluation at {samples:,} samples, {tried.physics} robots: {rate}")
    return found


def finish(run: Learning) -> dict:
    """Write the policy, try it on fresh goals at 1 kHz, and write the record, which is returned."""
    path = write_policy(run.exported(), run.folder, run.name)
    final = _tried(run, range(FINAL_SEED, FINAL_SEED + run.recipe.evaluation.final_trials))
    record = run.record() | {"policy": path.name, "final": [tried.document() for tried in final]}
    (run.folder / RECORD).write_text(json.dumps(record, indent=2) + "\n")
    return record


def _tried(run: Learning, seeds: range, **settings: float) -> list[Tried]:
    policy, task = run.exported(), TASKS[run.recipe.task]
    kinds = run.recipe.evaluation.physics if len(seeds) else ()
    return [try_policy(policy, policy.manifest, task, seeds, physics, threads=run.threads, **settings)[0] for physics in kinds]
