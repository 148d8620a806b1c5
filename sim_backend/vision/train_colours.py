"""Trains the classifier of pixels by colour on renders of this project alone, and writes it as a table over colours.

``python -m sim_backend.vision.train_colours --out sim_backend/vision/colours.npz``: robots of ``real-images``, cubes and fingers
anywhere, as many pixels of faces as of everything else; a network of two layers of 32 on blue, green, red, hue, saturation and
value. It needs torch (the extra ``learning``) and cameras that render.
"""

import argparse
from pathlib import Path

import numpy as np

from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.colours import LEVELS, features

PRESET = "real-images"
PIXELS_OF_A_VIEW = 300
"""Of the cube; as many of everything else."""
HIDDEN, BATCH, RATE = 32, 4096, 3e-3


def random_state(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint positions (9,) within their limits, and a pose of the cube: half of them on the floor, half in the air."""
    joints = rng.uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD)
    quat = rng.standard_normal(4)
    radius, angle = c.MAX_CUBE_CENTRE_DISTANCE_M * np.sqrt(rng.random()), rng.uniform(-np.pi, np.pi)
    height = c.CUBE_REST_HEIGHT_M
    if rng.random() < 0.5:
        quarter, face = rng.integers(4), rng.integers(6)
        quat = _resting(int(face), quarter * np.pi / 2 + rng.uniform(0, np.pi / 2))
    else:
        height = rng.uniform(c.CUBE_RADIUS_M, 0.15)
    return joints, np.array([radius * np.cos(angle), radius * np.sin(angle), height]), quat / np.linalg.norm(quat)


def _resting(face: int, yaw_rad: float) -> np.ndarray:
    """The orientation of a cube on the floor with a face up, turned about the vertical, wxyz."""
    from scipy.spatial.transform import Rotation

    axis = np.eye(3)[face // 2] * (1.0 - 2.0 * (face % 2))
    up = Rotation.align_vectors([[0.0, 0.0, 1.0]], [axis])[0]
    return (Rotation.from_rotvec([0.0, 0.0, yaw_rad]) * up).as_quat(scalar_first=True)


def coloured_pixels(robots: int, views: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, 3), uint8, blue first, and their classes (n,) out of renders of so many robots and states of each."""
    rng, colours, classes = np.random.default_rng(seed), [], []
    for _ in range(robots):
        physics = load_ranges(PRESET).draw(rng, 1)
        with Cameras(physics) as cameras:
            for view in range(views):
                state = random_state(rng)
                images, labels = cameras.take(*state, frame=view), cameras.labels(*state)
                for is_cube in (True, False):
                    rows = np.flatnonzero((labels.ravel() > 0) == is_cube)
                    drawn = rng.choice(rows, min(PIXELS_OF_A_VIEW, len(rows)), replace=False)
                    colours.append(images.reshape(-1, 3)[drawn][:, ::-1])
                    classes.append(labels.ravel()[drawn])
    return np.concatenate(colours), np.concatenate(classes)


def trained_table(bgr: np.ndarray, classes: np.ndarray, *, epochs: int, seed: int) -> np.ndarray:
    """The table of a network trained on colours (n, 3) and classes (n,)."""
    import torch
    from torch import nn

    torch.manual_seed(seed)
    network = nn.Sequential(
        nn.Linear(6, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, len(c.CUBE_FACE_COLOURS) + 1)
    )
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
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robots", type=int, default=40)
    parser.add_argument("--views", type=int, default=10, help="states of each robot")
    parser.add_argument("--epochs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    bgr, classes = coloured_pixels(options.robots, options.views, options.seed)
    table = trained_table(bgr, classes, epochs=options.epochs, seed=options.seed)
    told = np.array([options.robots, options.views, options.epochs, options.seed])
    np.savez_compressed(options.out, table=table, robots_views_epochs_seed=told)
    step = 256 // LEVELS
    right, of_faces = table[tuple((bgr // step).T)] == classes, classes > 0
    print(f"{len(bgr)} pixels, {right.mean():.3f} right; of faces {right[of_faces].mean():.3f}")


if __name__ == "__main__":
    main()
