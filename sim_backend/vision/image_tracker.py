"""The tracker on images: a network tells pixels of the cube, a pose explains them all, and it says "not seen" rather than guess.

One image of each camera goes in. The pose of the last frame is one more start of the fit, never an answer by itself, so that a
wrong one does not last.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.trifinger.objects import CUBE
from sim_backend.vision.calibration import Calibration
from sim_backend.vision.face_fit import sharpened
from sim_backend.vision.pose_fit import Fit, fitted, rays_of
from sim_backend.vision.rotations import quat_of_matrix
from sim_backend.vision.seen_pixels import FACES, SeenPixels, outputs_of, pixels_of

FEWEST_PIXELS = 12
"""Of all images together, at the network's resolution, below which nothing is fitted."""
FACE_PIXELS = 6
"""A camera sees a face from so many pixels at the network's resolution on."""
CORRELATED_PIXELS = 10.0
"""Errors of neighbouring pixels go together: so many count as one, by renders of 8 robots that are
neither learnt from nor judged by."""
MISFIT_PX, SCARCE_PIXELS = 5.0, 12.0
"""Of the confidence: outlines that miss by so much, or so few pixels, leave little of it."""
SURE = 0.75
"""Confidence from which on the driver's filter takes a pose, and the next frame begins with it."""
CALIBRATION_M, CALIBRATION_RAD = 0.001, 0.005
"""What no pixel can tell: errors of the cameras' calibration, as standard deviations of the pose."""
FARTHEST_M, HIGHEST_M = 0.25, 0.4
"""Poses farther from the middle of the arena, or higher, are none."""


@dataclass(frozen=True)
class SeenPose:
    """A pose of the cube found in images.

    Attributes:
        position_world_m: shape (3,).
        rotation: shape (3, 3).
        quat_wxyz: shape (4,).
        covariance: of position in m and of the rotation vector in the world's frame in rad, shape (6, 6).
        confidence: how well it explains what is seen, from 0 to 1; 0 where nothing was seen, and the rest means nothing then.
        visible_faces: which of ``CUBE_FACE_COLOURS`` each camera sees, shape (cameras, 6).
    """

    position_world_m: np.ndarray
    rotation: np.ndarray
    quat_wxyz: np.ndarray
    covariance: np.ndarray
    confidence: float
    visible_faces: np.ndarray


class ImageTracker:
    """Finds the cube in images of calibrated cameras. Owner of the last pose.

    Args:
        calibrations: of the cameras, for the images' sizes.
        size_m: of the cube, along its axes.
    """

    def __init__(self, calibrations: Sequence[Calibration], size_m: tuple[float, float, float] = CUBE.size_m) -> None:
        self._calibrations, self._half_m = tuple(calibrations), np.array(size_m) / 2
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def forget(self) -> None:
        """The next images have nothing to do with those before."""
        self._last = None

    def track(self, images: np.ndarray | Sequence[np.ndarray], cameras: Sequence[int] | None = None) -> SeenPose:
        """Where the cube is.

        Args:
            images: one of each camera, shape (height, width, 3), uint8, red first.
            cameras: which cameras these are; all of them if None. Without any there is nothing to see.
        """
        which = list(range(len(self._calibrations)) if cameras is None else cameras)
        seen = [pixels_of(output) for output in outputs_of(images)] if which else []
        return self.track_pixels(seen, which)

    def track_pixels(self, seen: Sequence[SeenPixels], cameras: Sequence[int]) -> SeenPose:
        """Where the cube is, from the pixels of it in the image of each of these cameras."""
        faces = np.zeros((len(self._calibrations), len(FACES)), dtype=bool)
        for camera, pixels in zip(cameras, seen, strict=True):
            faces[camera] = np.bincount(pixels.face, minlength=len(FACES)) >= FACE_PIXELS
        if sum(len(pixels.face) for pixels in seen) < FEWEST_PIXELS:
            return self._nothing(faces)
        calibrations, rng = [self._calibrations[camera] for camera in cameras], np.random.default_rng(0)
        fit = fitted(rays_of(seen, calibrations, self._half_m), rng)[0]
        starts = [(fit.position_m, fit.rotation), *([] if self._last is None else [self._last])]
        width_m = 2 * float(self._half_m.mean())
        found = [sharpened(*start, seen, calibrations, width_m, np.random.default_rng(0)) for start in starts]
        position_m, rotation, outline_px = min(found, key=lambda each: each[2])
        confidence = confidence_of(outline_px, sum(len(pixels.face) for pixels in seen))
        if not _possible(position_m):
            return self._nothing(faces)
        self._last = (position_m, rotation) if confidence >= SURE else None
        return SeenPose(position_m, rotation, quat_of_matrix(rotation), covariance_of(fit), confidence, faces)

    def _nothing(self, faces: np.ndarray) -> SeenPose:
        self._last = None
        return SeenPose(np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0, 0.0]), np.full((6, 6), np.inf), 0.0, faces)


def covariance_of(fit: Fit) -> np.ndarray:
    """Covariance (6, 6) of a pose: of its pixels, which do not err independently, and of the cameras' calibration."""
    floor = np.repeat([CALIBRATION_M, CALIBRATION_RAD], 3) ** 2
    return CORRELATED_PIXELS * fit.covariance + np.diag(floor)


def confidence_of(outline_px: float, pixels: int) -> float:
    """How well a pose explains what is seen, from 0 to 1: by the misfit of outlines, px, and by how many pixels there are."""
    return float(np.exp(-outline_px / MISFIT_PX) * pixels / (pixels + SCARCE_PIXELS))


def _possible(position_m: np.ndarray) -> bool:
    x, y, z = position_m
    return bool(np.hypot(x, y) < FARTHEST_M and -0.02 < z < HIGHEST_M)
