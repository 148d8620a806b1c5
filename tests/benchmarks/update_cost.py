"""What the learner's updates cost for each sample: ``python -m tests.benchmarks.update_cost --out FILE``.

A run of a recipe learns some iterations, rolled out in the calling process, and the seconds of its updates are counted:
by the clock, which other work on the machine disturbs, and of the processor, for all threads together.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from tests.benchmarks.machine import kind


def measured(recipe_name: str, iterations: int, threads: int, robots: int | None) -> dict[str, Any]:
    """Microseconds of an update for each sample of its iteration."""
    from sim_backend.training.recipe import Recipe, load_recipe
    from sim_backend.training.sliced_ppo import SlicedPPO
    from sim_backend.training.train import Run

    recipe = load_recipe(recipe_name)[1]
    assert isinstance(recipe, Recipe), "recipes of imitation have no such updates"
    ppo = recipe.ppo.model_copy(update={} if robots is None else {"robots": robots, "minibatch": robots * recipe.ppo.steps // 4})
    samples = ppo.robots * ppo.steps
    evaluation = recipe.evaluation.model_copy(update={"every_samples": 10**12})
    recipe = recipe.model_copy(update={"ppo": ppo, "samples": iterations * samples, "minutes": None, "evaluation": evaluation})
    wall_us, cpu_us = [], []
    with tempfile.TemporaryDirectory() as folder:
        run = Run("mine", recipe, Path(folder), threads=threads, workers=0, tell=lambda _: None)
        assert isinstance(run.model, SlicedPPO)
        train = run.model.train

        def timed() -> None:
            wall_s, cpu_s = time.perf_counter(), time.process_time()
            train()
            wall_us.append(1e6 * (time.perf_counter() - wall_s) / samples)
            cpu_us.append(1e6 * (time.process_time() - cpu_s) / samples)

        run.model.train = timed
        run.learn()
    return {
        "samples_of_an_iteration": samples,
        "us_a_sample": {"median": median(wall_us), "least": min(wall_us), "greatest": max(wall_us)},
        "processor_us_a_sample": {"median": median(cpu_us), "least": min(cpu_us), "greatest": max(cpu_us)},
    }


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="What the learner's updates cost for each sample.")
    parser.add_argument("--recipe", default="push")
    parser.add_argument("--iterations", type=int, default=6)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--robots", type=int, help="other than the recipe's, with four minibatches")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as in a training: threads that wait would spin on the cores of others
    how = {"machine": kind(), "recipe": asked.recipe, "iterations": asked.iterations, "threads": asked.threads}
    found = how | {"load_before": os.getloadavg()[0]} | measured(asked.recipe, asked.iterations, asked.threads, asked.robots)
    text = json.dumps(found | {"load_after": os.getloadavg()[0]}, indent=1)
    print(text)
    if asked.out:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
