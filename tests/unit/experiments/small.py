"""A small experiment and results for it, made up."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from api_schemas.policy import LAYOUTS
from experiments.agreement import training_of
from experiments.catalogue import CATALOGUE
from experiments.design import Cell, Contrast, Experiment, Farm, FarmTrials, Measure
from experiments.recipe_files import wanted_recipe
from experiments.result_files import Key
from experiments.store import Store
from sim_backend.training.recipe import load_recipe

TRIALS = FarmTrials("push", farms=(Farm("real"),), blocks=2, block=5, seed=100)
SMALL = Experiment(
    letter="x",
    name="small",
    title="A small one",
    question="Does it work?",
    claims=(),
    limits="None.",
    cells=(
        Cell("first", "the first", (1, 2), replace(CATALOGUE["randomization"].cell("nominal").training, start=None)),
        Cell("other", "the other", (1, 2), replace(CATALOGUE["randomization"].cell("randomized").training, start=None)),
    ),
    contrasts=(Contrast("other against first", Measure.SUCCESS, "first", "other", 0.2),),
    trials=TRIALS,
    curves=True,
)


def store_of(folder: Path, experiment: Experiment = SMALL) -> Store:
    return Store(folder / "results", folder / "work", experiment)


def record(stem: str, samples: int = 4096, rates=(0.2, 0.6, 0.9)) -> dict:
    """What the training program leaves, as far as it is kept."""
    steps = [samples * (index + 1) // len(rates) for index in range(len(rates))]
    return {
        "settings": {"task": "push", "physics": "/home/someone/ranges.toml"},
        "samples": samples,
        "wall_s": 12.0,
        "starts": 1,
        "curve": [{"samples": index} for index in range(200)],
        "evaluations": [
            {"samples": at, "physics": "nominal", "success_rate": rate, "trials": 64}
            for at, rate in zip(steps, rates, strict=True)
        ],
        "final": [{"physics": "nominal", "success_rate": rates[-1]}],
        "policy": f"{stem}.safetensors",
    }


def write_policy(folder: Path, stem: str, numbers: int = 100) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    save_file({"layer0.weight": np.zeros(numbers, dtype=np.float32)}, folder / f"{stem}.safetensors")
    (folder / f"{stem}.json").write_text(LAYOUTS["keypoints"].model_dump_json())


def leave_training(folder: Path, stem: str, **how) -> dict:
    """Everything that a finished training leaves in its folder; its recipe may lie there."""
    write_policy(folder, stem)
    made = record(stem, **how)
    if (recipe := folder / f"{stem}.toml").exists():
        made["settings"] = load_recipe(str(recipe))[1].model_dump(mode="json")
    (folder / "record.json").write_text(json.dumps(made))
    return made


def train(store: Store, cell: Cell, seed: int, **how) -> None:
    """Keep a finished training."""
    made = leave_training(store.training_folder(cell, seed), Key(cell.name, seed).stem, **how)
    made["settings"] = wanted_recipe(training_of(cell), seed).model_dump(mode="json")
    store.keep_run(cell, seed, made, "d" * 64)


def rows(block: int, reached: int, trials: int = 5) -> list[dict]:
    return [{"goal": 10 * block + index, "robot": "robot-0", "reached": index < reached} for index in range(trials)]


def complete(folder: Path, first: int = 1, other: int = 4) -> Store:
    """All results of the small experiment, with so many of five goals reached in each block."""
    store = store_of(folder)
    for cell, reached in zip(SMALL.cells, (first, other), strict=True):
        for seed in cell.seeds:
            train(store, cell, seed)
            for block in range(TRIALS.blocks):
                store.keep_block(Key(cell.name, seed, "real"), block, rows(block, reached), {"task": "push"})
    return store


def quick_small() -> Experiment:
    return replace(SMALL, quick=True)
