"""What it costs and gains that rollouts run one update behind: ``python -m tests.benchmarks.rollouts_behind --out FILE``.

A recipe is learned with the same seeds both ways, in turns: workers wait for the updates of an iteration, or roll out the next
meanwhile. The curve of each training, its time, its lag and the success of its policy on fresh goals go into the file.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command has it: torch's threads do not spin while they wait

from sim_backend.training import evaluating
from sim_backend.training.recipe import Recipe, load_recipe
from sim_backend.training.train import Run
from tests.benchmarks.machine import kind

KEPT = ("samples", "wall_s", "return", "success_rate")
OF_WORKERS = ("lag_updates", "importance_weight", "weights_limited_share", "learner_idle_share", "seconds")


def learned(recipe: Recipe, workers: int, seed: int, lag: int) -> dict[str, Any]:
    """One training from its begin to its trial on fresh goals."""
    settings = recipe.model_copy(update={"seed": seed, "ppo": recipe.ppo.model_copy(update={"lag": lag})})
    with tempfile.TemporaryDirectory() as name:
        run = Run("behind", settings, Path(name), threads=workers, workers=workers, tell=lambda _: None)
        begun_s = time.monotonic()
        run.learn()
        took_s = time.monotonic() - begun_s
        record = run.finish()
    curve = [{name: point[name] for name in KEPT} for point in record["curve"]]
    (final,) = record["final"]
    return {
        "seed": seed,
        "lag": lag,
        "took_s": round(took_s, 1),
        "samples": record["samples"],
        **{name: record["workers"][name] for name in OF_WORKERS},
        "final": {name: final[name] for name in ("trials", "success_rate", "interval_80")},
        "curve": curve[:: max(1, len(curve) // 30)],
    }


def main() -> None:
    """Learns, keeps each training when it has ended, and prints a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recipe", default="reach")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--samples", type=int, help="of each training; the recipe's by default")
    parser.add_argument("--final-trials", type=int, default=100)
    asked = parser.parse_args()
    _, recipe = load_recipe(asked.recipe)
    if not isinstance(recipe, Recipe):
        parser.error(f"{asked.recipe} imitates; workers go with PPO")
    samples = asked.samples or recipe.samples
    nominal = recipe.evaluation.model_copy(update={"final_trials": asked.final_trials, "physics": ("nominal",)})
    recipe = recipe.model_copy(update={"samples": samples, "evaluation": nominal})
    document: dict[str, Any] = {"machine": kind(), "recipe": asked.recipe, "workers": asked.workers, "trainings": []}
    for place, seed in enumerate(asked.seeds):
        for lag in (0, 1) if place % 2 == 0 else (1, 0):
            with patch.object(evaluating, "TELL_EVERY_S", 0.0):  # a point of the curve for each iteration
                done = learned(recipe, asked.workers, seed, lag)
            document["trainings"].append(done)
            asked.out.write_text(json.dumps(document, indent=1) + "\n")
            success = done["final"]["success_rate"]
            print(f"seed {seed}, lag {lag}: {done['took_s']} s, success {success:.0%}, behind {done['lag_updates']}", flush=True)


if __name__ == "__main__":
    main()
