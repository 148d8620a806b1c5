"""Trains the network of the tracker on images: ``trifarm train tracker``, ``python -m sim_backend.vision.train_tracker``.

First it renders what to learn from (``lessons.py``, in a process of its own), then it trains, and writes the network as ONNX.
Every epoch ends with a checkpoint, from which ``--resume`` goes on. Crops are changed anew whenever they are shown: light,
colours, noise, blur, things before the cube, other backgrounds. That is what separates renders from photographs.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

from sim_backend.extras import how_to_install
from sim_backend.refusal import refused

OK, OTHER, USAGE, INTERRUPTED = 0, 1, 2, 130
FIRST_SEED, ROBOTS, HELD_OUT = 1000, 174, 6
"""Robots that it learns from by their seeds, and how many more only tell how well it does."""
EPOCHS = 5
CHECKPOINT, NETWORK = "checkpoint.pt", "tracker.onnx"


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    folder = options.out
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / CHECKPOINT).exists() and not options.resume:
        said = f"{folder} has the checkpoint of a run; give --resume to go on with it, or another --out"
        return refused(said, options.json, USAGE)
    lessons = folder / "lessons"
    first, every = options.first_robot, options.robots + HELD_OUT
    rendering = [sys.executable, "-m", "sim_backend.vision.lessons", "--out", str(lessons), "--first", str(first)]
    if subprocess.run([*rendering, "--robots", str(every)], check=False, stdout=sys.stderr).returncode:
        return refused("the images to learn from could not be rendered", options.json, OTHER)
    try:
        import torch

        from sim_backend.vision.tracker_training import Training
    except ImportError as error:
        said = f"training needs packages that are not installed ({error.name}): {how_to_install('learning', 'vision')}"
        return refused(said, options.json, OTHER)
    if options.threads:
        torch.set_num_threads(options.threads)
    files = [lessons / f"robot-{first + k}.npz" for k in range(every)]
    learnt, held_out = files[: options.robots], files[options.robots :]
    training = Training(learnt, held_out, folder / CHECKPOINT, epochs=options.epochs, begin=options.begin)
    try:
        while training.epoch < options.epochs:
            print(json.dumps(training.learn()), file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("stopped; with --resume it goes on from its checkpoint", file=sys.stderr)
        return INTERRUPTED
    training.export(folder / NETWORK)
    said = {"network": str(folder / NETWORK), "bytes": (folder / NETWORK).stat().st_size, **training.told[-1]}
    print(json.dumps(said) if options.json else f"{said['network']}: {said['bytes']} bytes, held out: {training.told[-1]}")
    return OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm train tracker", description="Train the network of the tracker on images.")
    parser.add_argument("--out", type=Path, default=Path("train-tracker"))
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--robots", type=int, default=ROBOTS, help="how many to learn from")
    parser.add_argument("--first-robot", type=int, default=FIRST_SEED, help="seed of the first of them")
    parser.add_argument("--begin", type=Path, metavar="NETWORK", help="begin with the weights of this network (.onnx)")
    parser.add_argument("--epochs", type=int, default=EPOCHS)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--json", action="store_true")
    return parser


if __name__ == "__main__":
    sys.exit(main())
