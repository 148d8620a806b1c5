"""What the tracker's network sees in images: pixels of the cube, the face that each shows and the place on it.

The network is an ONNX graph beside this file, run by onnxruntime on one core as policies are; ``train_tracker.py`` made it of
renders of this project alone.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy_graph import session
from sim_backend.trifinger import constants as c

FACES = tuple(c.CUBE_FACE_COLOURS)
CLASSES = len(FACES) + 1
"""Class 0 is everything but the cube; face k of ``FACES`` is class k + 1."""
STRIDE = 2
"""The network tells of every second pixel of every second row, beginning with the first."""
MULTIPLE = 16
"""Sizes of images that it takes."""
NETWORK_FILE = Path(__file__).parent / "tracker.onnx"
LIKELY = 0.5
"""Probability from which on a pixel is taken for one of the cube."""


@dataclass(frozen=True)
class SeenPixels:
    """Pixels of the cube in one image.

    Attributes:
        pixel: where they are, shape (n, 2), px: column and row.
        face: which of ``FACES`` they show, shape (n,).
        place: on the cube, in its frame and half its width, shape (n, 3).
        expected_error: of the place, in half the cube's width, shape (n,).
    """

    pixel: np.ndarray
    face: np.ndarray
    place: np.ndarray
    expected_error: np.ndarray


@functools.cache
def network(path: Path = NETWORK_FILE) -> Any:
    """The network on one core, loaded once a process."""
    return session(path)


def outputs_of(images: np.ndarray | Sequence[np.ndarray], path: Path = NETWORK_FILE) -> np.ndarray:
    """What the network says of images.

    Args:
        images: shape (n, height, width, 3), uint8, red first.
        path: of the network.

    Returns:
        Shape (n, 11, rows, columns): logits of classes, places, logarithms of errors.
    """
    stack = np.asarray(images)
    missing = [(0, -size % MULTIPLE) for size in stack.shape[1:3]]
    padded = np.pad(stack, [(0, 0), *missing, (0, 0)], mode="edge")
    planes = np.ascontiguousarray(padded.transpose(0, 3, 1, 2), dtype=np.float32) / np.float32(255.0)
    out = network(path).run(None, {"images": planes})[0]
    rows, columns = (-(-size // STRIDE) for size in stack.shape[1:3])
    return out[:, :, :rows, :columns]


def probabilities(output: np.ndarray) -> np.ndarray:
    """Of the classes, shape (7, rows, columns), from what the network says of one image, shape (11, rows, columns)."""
    logits = output[:CLASSES] - output[:CLASSES].max(axis=0)
    weights = np.exp(logits)
    return weights / weights.sum(axis=0)


def pixels_of(output: np.ndarray) -> SeenPixels:
    """The cube's pixels in what the network says of one image, shape (11, rows, columns)."""
    chance = probabilities(output)
    rows, columns = np.nonzero(chance[0] < 1.0 - LIKELY)
    face = chance[1:, rows, columns].argmax(axis=0)
    place = output[CLASSES : CLASSES + 3, rows, columns].T.astype(float)
    expected = np.exp(np.clip(output[-1, rows, columns], -5.0, 2.0)).astype(float)
    return SeenPixels(STRIDE * np.stack([columns, rows], axis=1).astype(float), face, place, expected)
