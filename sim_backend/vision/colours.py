"""Which pixels show which face of the cube: a table over quantised colours, made of a small trained classifier.

The classifier (``train_colours.py``) reads blue, green, red, hue, saturation and value of a pixel, as the real tracker's does.
All six follow from the first three, so that a table over those three, ``LEVELS`` steps each, says the same and is a look-up.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.vision.pictures import opencv
from sim_backend.vision.seen_pixels import FACES

BACKGROUND = 0
"""Class of everything but the cube; face k of ``FACES`` is class k + 1."""
LEVELS = 32
TABLE_FILE = Path(__file__).parent / "colours.npz"
SHOWN_FACES = 3
"""A box shows no more to one camera."""
LEAST_PIXELS = 8
"""A colour with fewer pixels in an image is taken for noise."""


@functools.cache
def colour_table() -> np.ndarray:
    """Class of each colour, shape (``LEVELS``, ``LEVELS``, ``LEVELS``) over blue, green, red, uint8."""
    with np.load(TABLE_FILE) as kept:
        return kept["table"]


def features(bgr: np.ndarray) -> np.ndarray:
    """What the classifier reads of colours (n, 3), uint8, blue first: those, hue, saturation and value, shape (n, 6), 0 to 1."""
    cv2 = opencv()
    hsv = cv2.cvtColor(np.ascontiguousarray(bgr[None]), cv2.COLOR_BGR2HSV)[0]
    return np.hstack([bgr / 255.0, hsv / np.array([180.0, 255.0, 255.0])]).astype(np.float32)


def classified(image: np.ndarray, table: np.ndarray | None = None) -> np.ndarray:
    """Class of each pixel of an image, shape (height, width), uint8; ``image`` (height, width, 3), uint8, red first."""
    step = 256 // LEVELS
    red, green, blue = (image[..., k] // step for k in range(3))
    return (colour_table() if table is None else table)[blue, green, red]


def segmented(image: np.ndarray, table: np.ndarray | None = None) -> np.ndarray:
    """Classes after the real tracker's steps: median, classifier, opening of each colour, and the three largest of them.

    Args:
        image: shape (height, width, 3), uint8, red first.
        table: of colours; the kept one if None.

    Returns:
        Shape (height, width), uint8.
    """
    cv2: Any = opencv()
    classes = classified(cv2.medianBlur(np.ascontiguousarray(image), 3), table)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    masks = [cv2.morphologyEx((classes == face + 1).astype(np.uint8), cv2.MORPH_OPEN, cross) for face in range(len(FACES))]
    sizes = np.array([int(mask.sum()) for mask in masks])
    out = np.zeros(classes.shape, np.uint8)
    for face in np.argsort(-sizes)[:SHOWN_FACES]:
        if sizes[face] >= LEAST_PIXELS:
            out[masks[face] > 0] = face + 1
    return out
