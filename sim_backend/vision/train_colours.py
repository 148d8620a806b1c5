"""Trains the classifier of pixels by colour on renders of this project alone, and writes it as a table over colours.

``python -m sim_backend.vision.train_colours LESSONS --out sim_backend/vision/colours.npz``: as many pixels of faces as of
everything else out of the crops of ``lessons.py``; a network of two layers of 32 on blue, green, red, hue, saturation and value.
It needs torch (the extra ``learning``).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim_backend.vision.colours import LEVELS, features
from sim_backend.vision.seen_pixels import CLASSES

PIXELS_OF_A_ROBOT = 6000
"""Of the cube; as many of everything else."""
HIDDEN, BATCH, RATE = 32, 4096, 3e-3


def coloured_pixels(files: Sequence[Path], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, 3), uint8, blue first, and their classes (n,) out of crops."""
    colours, classes = [], []
    for file in files:
        with np.load(file) as crops:
            image, face = crops["image"].reshape(-1, 3), crops["face"].ravel()
        for is_cube in (True, False):
            rows = np.flatnonzero((face > 0) == is_cube)
            drawn = rng.choice(rows, min(PIXELS_OF_A_ROBOT, len(rows)), replace=False)
            colours.append(image[drawn][:, ::-1])
            classes.append(face[drawn])
    return np.concatenate(colours), np.concatenate(classes)


def trained_table(bgr: np.ndarray, classes: np.ndarray, *, epochs: int, seed: int) -> np.ndarray:
    """The table of a network trained on colours (n, 3) and classes (n,)."""
    import torch
    from torch import nn

    torch.manual_seed(seed)
    network = nn.Sequential(nn.Linear(6, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, CLASSES))
    inputs, wanted = torch.from_numpy(features(bgr)), torch.from_numpy(classes.astype(np.int64))
    optimiser = torch.optim.Adam(network.parameters(), lr=RATE)
    for _ in range(epochs):
        for rows in torch.randperm(len(inputs)).split(BATCH):
            optimiser.zero_grad()
            nn.functional.cross_entropy(network(inputs[rows]), wanted[rows]).backward()
            optimiser.step()
    step = 256 // LEVELS
    levels = (np.arange(LEVELS) * step + step // 2).astype(np.uint8)
    every = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    with torch.no_grad():
        best = network(torch.from_numpy(features(every))).argmax(dim=1)
    return best.numpy().astype(np.uint8).reshape(LEVELS, LEVELS, LEVELS)


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Train the classifier of pixels by colour.")
    parser.add_argument("lessons", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    files = sorted(options.lessons.glob("robot-*.npz"))
    bgr, classes = coloured_pixels(files, np.random.default_rng(options.seed))
    table = trained_table(bgr, classes, epochs=options.epochs, seed=options.seed)
    np.savez_compressed(options.out, table=table, robots_epochs_seed=np.array([len(files), options.epochs, options.seed]))
    step = 256 // LEVELS
    right, of_faces = table[tuple((bgr // step).T)] == classes, classes > 0
    print(f"{len(bgr)} pixels, {right.mean():.3f} right; of faces {right[of_faces].mean():.3f}")


if __name__ == "__main__":
    main()
