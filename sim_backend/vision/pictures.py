"""Images as files: JPEG in logs, PNG or JPEG for people, three views side by side, with the cube's edges drawn in."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_backend.extras import how_to_install
from sim_backend.trifinger.objects import CUBE, Shape
from sim_backend.vision.calibration import Calibration

JPEG_QUALITY = 50
"""Of images in logs: 4 to 5.5 kB for a view of 270 x 270 pixels, so that a log of 30 s stays below 15 MB."""
_EDGE_COLOUR = (255, 255, 255)


def opencv() -> Any:
    """OpenCV, which only the extra ``vision`` has.

    Raises:
        ImportError: it is not installed; the message says how.
    """
    try:
        import cv2
    except ImportError as error:
        raise ImportError(f"images need OpenCV ({error}): {how_to_install('vision')}") from error
    return cv2


def as_jpeg(image: np.ndarray, quality: int = JPEG_QUALITY) -> bytes:
    """An image, shape (height, width, 3), uint8, red first, as a JPEG file."""
    return as_file(image, ".jpg", quality)


def as_file(image: np.ndarray, suffix: str, quality: int = 95) -> bytes:
    """An image, shape (height, width, 3), uint8, red first, as a file of that suffix: .png, .jpg or .jpeg.

    Raises:
        ValueError: another suffix.
    """
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"a picture is {suffix or 'without a suffix'}; choose from .png, .jpg and .jpeg")
    cv2 = opencv()
    settings = [] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, quality]
    done, data = cv2.imencode(suffix, np.ascontiguousarray(image[..., ::-1]), settings)
    assert done, "OpenCV wrote no image"
    return data.tobytes()


def from_jpeg(data: bytes) -> np.ndarray:
    """The image of a JPEG file, shape (height, width, 3), uint8, red first.

    Raises:
        ValueError: it is none.
    """
    cv2 = opencv()
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{len(data)} bytes are no JPEG image")
    return np.ascontiguousarray(image[..., ::-1])


def side_by_side(images: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Views of one height beside each other, shape (height, sum of widths, 3)."""
    return np.hstack(list(images))


def with_object(
    image: np.ndarray,
    calibration: Calibration,
    position_world_m: np.ndarray,
    rotation: np.ndarray,
    shape: Shape = CUBE,
) -> np.ndarray:
    """An image with the edges of the object's box where a calibration puts them.

    Args:
        image: shape (height, width, 3), uint8.
        calibration: of the camera.
        position_world_m: of the object, shape (3,).
        rotation: of the object, shape (3, 3).
        shape: the object.
    """
    cv2 = opencv()
    half = np.array(shape.size_m) / 2
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = calibration.project((signs * half) @ rotation.T + position_world_m)
    drawn = image.copy()
    for first in range(8):
        for second in range(first + 1, 8):
            ends = corners[[first, second]]
            if (signs[first] != signs[second]).sum() == 1 and np.isfinite(ends).all():
                (a, b), (c, d) = np.clip(np.rint(ends * 16), -(2**20), 2**20).astype(int).tolist()
                cv2.line(drawn, (a, b), (c, d), _EDGE_COLOUR, 1, cv2.LINE_AA, 4)
    return drawn
