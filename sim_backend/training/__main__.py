"""The command behind ``trifarm train``; see ``train.py``."""

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from sim_backend.extras import how_to_install
from sim_backend.folder_lock import TakenError, taken
from sim_backend.refusal import ended, refused
from sim_backend.training.folder import CHECKPOINT
from sim_backend.workers.pool import WorkersError
from trial_logs.loading import everything_stays

if TYPE_CHECKING:
    from sim_backend.training.demonstrations.recipe import ImitationRecipe
    from sim_backend.training.recipe import Recipe

OK, OTHER, USAGE, INTERRUPTED = 0, 1, 2, 130
LEARNER_GOES_S = 10.0
"""What a learner that was killed a moment ago has to be gone; two would write one checkpoint."""


def main(arguments: list[str] | None = None) -> int:
    """Train as asked; returns the exit code."""
    options = _parser().parse_args(arguments)
    if options.cluster is not None and options.workers is None:
        options.workers = 1
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # torch's threads would wait by spinning on the cores of the physics
    from sim_backend.training.recipe import RecipeError, load_recipe

    try:
        name, recipe = load_recipe(options.recipe)
    except RecipeError as error:
        return refused(error, options.json, USAGE)
    folder = options.out or Path(f"train-{name}")
    there = (folder / CHECKPOINT).exists()
    if there != options.resume:
        begun = "has the checkpoint of a run; give --resume to go on with it, or another --out"
        said = f"{folder} {begun if there else 'has no checkpoint to go on from; leave --resume out to begin'}"
        return refused(said, options.json, USAGE)
    try:
        with everything_stays():  # after all that can be refused without torch, which takes seconds to load
            import sim_backend.training.train  # noqa: F401
    except ImportError as error:
        said = f"training needs packages that are not installed ({error.name}): {how_to_install('learning')}"
        return refused(said, options.json, OTHER)
    try:
        with taken(folder, "a training", "give another --out", patience_s=LEARNER_GOES_S, lock="learner.lock"):
            return _begun(name, recipe, folder, options)
    except TakenError as error:
        return refused(error, options.json, USAGE)


def _begun(name: str, recipe: "Recipe | ImitationRecipe", folder: Path, options: argparse.Namespace) -> int:
    from sim_backend.training.demonstrations.run import ImitationRun
    from sim_backend.training.recipe import Recipe
    from sim_backend.training.train import Run

    try:
        make = {"name": name, "folder": folder, "threads": options.threads, "tell": _tell}
        spread = {"workers": options.workers, "cluster": options.cluster}
        if not isinstance(recipe, Recipe) and options.workers is not None:
            raise ValueError("it imitates, and --workers goes with PPO only")
        with everything_stays():  # torch loads its compiler with the first optimiser
            run = Run(recipe=recipe, **make, **spread) if isinstance(recipe, Recipe) else ImitationRun(recipe=recipe, **make)
        if options.resume:
            run.go_on()
    except ValueError as error:
        return refused(f"recipe {name}: {error}", options.json, USAGE)
    return _train(run, options, _tell)


def _train(run, options: argparse.Namespace, tell: Callable[[str], None]) -> int:
    if options.resume:
        tell(f"goes on at {run.samples:,} samples")
    before = signal.signal(signal.SIGINT, lambda *_: run.stop())  # an exception would break compiled code apart
    try:
        run.learn()
    except WorkersError as error:
        if run.samples:
            run.keep()  # what was under way was not learned from
        return refused(error, options.json, OTHER)
    finally:
        signal.signal(signal.SIGINT, before)
    run.keep()
    if run.stopped:
        tell(f"stopped at {run.samples:,} samples; --resume goes on from there")
        return INTERRUPTED
    record = run.finish()
    policy = run.folder / record["policy"]
    if options.json:
        print(json.dumps(document(record, run.folder), indent=2))
    else:
        for tried in record["final"]:
            low, high = tried["interval_80"]
            rate = f"{tried['success_rate']:.1%} (80 % interval {low:.1%} to {high:.1%})"
            print(f"{tried['physics']} robots, {tried['trials']} fresh goals: {rate}")
        print(f"{policy} can be uploaded: trifarm submit {policy} --task {run.recipe.task}")
    return OK


def document(record: dict, folder: Path) -> dict:
    """What ``--json`` prints of a run's record."""
    files = {"folder": str(folder), "policy": str(folder / record["policy"])}
    return files | {key: record[key] for key in ("recipe", "samples", "wall_s", "final")}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm train", description="Train a policy by a recipe.")
    parser.add_argument("recipe", help="name of a shipped recipe, or a TOML file")
    parser.add_argument("--out", type=Path, help="folder of the run; train-RECIPE if left out")
    parser.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--workers", type=int, help="processes that roll out slices of the robots")
    parser.add_argument("--cluster", help="Ray that has the workers: local, or HOST:PORT")
    parser.add_argument("--json", action="store_true")
    return parser


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(ended(main))
