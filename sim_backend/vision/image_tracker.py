"""The tracker on images: a network tells pixels of the cube, a pose explains them all, and it says "not seen" rather than guess.

One image of each camera goes in. The pose of the last frame is one more start of the fit, never an answer by itself, so that a
wrong one does not last.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.trifinger.objects import CUBE
from sim_backend.vision.calibration import Calibration
from sim_backend.vision.pose_fit import Fit, fitted, rays_of
from sim_backend.vision.rotations import quat_of_matrix
from sim_backend.vision.seen_pixels import FACES, SeenPixels, outputs_of, pixels_of

FEWEST_PIXELS = 12
"""Of all images together, at the network's resolution, below which nothing is fitted."""
FACE_PIXELS = 6
"""A camera sees a face from so many pixels at the network's resolution on."""
CORRELATED_PIXELS = 60.0
"""Errors of neighbouring pixels go together: so many count as one."""
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
        confidence: probability that the pose is right to 15 mm and 20 degrees; 0 where nothing was seen, and the rest means
            nothing then.
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
        self._last: Fit | None = None

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
        rays = rays_of(seen, [self._calibrations[camera] for camera in cameras], self._half_m)
        starts = [] if self._last is None else [(self._last.position_m, self._last.rotation)]
        fits = fitted(rays, np.random.default_rng(len(rays.error_m)), starts)
        best = fits[0]
        confidence = confidence_of(best, fits[1].cost if len(fits) > 1 else np.inf, len(rays.error_m))
        if not _possible(best):
            return self._nothing(faces)
        self._last = best if confidence >= 0.5 else None
        return SeenPose(best.position_m, best.rotation, quat_of_matrix(best.rotation), covariance_of(best), confidence, faces)

    def _nothing(self, faces: np.ndarray) -> SeenPose:
        self._last = None
        return SeenPose(np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0, 0.0]), np.full((6, 6), np.inf), 0.0, faces)


def covariance_of(fit: Fit) -> np.ndarray:
    """Covariance (6, 6) of a pose: of its pixels, which do not err independently, and of the cameras' calibration."""
    floor = np.repeat([CALIBRATION_M, CALIBRATION_RAD], 3) ** 2
    return CORRELATED_PIXELS * fit.covariance + np.diag(floor)


def confidence_of(fit: Fit, next_cost: float, pixels: int) -> float:
    """Probability that a pose is right to 15 mm and 20 degrees, from what its fit shows; see ``CONFIDENCE_WEIGHTS``."""
    return float(1.0 / (1.0 + np.exp(-features_of(fit, next_cost, pixels) @ CONFIDENCE_WEIGHTS)))


def features_of(fit: Fit, next_cost: float, pixels: int) -> np.ndarray:
    """What the confidence is computed from, shape (6,): one, logarithms of pixels, of the pose's deviations and of its cost."""
    deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(fit.covariance[:3, :3]).max(), 1e-12))
    turn = np.sqrt(np.maximum(np.linalg.eigvalsh(fit.covariance[3:, 3:]).max(), 1e-12))
    apart = min(np.log(next_cost / max(fit.cost, 1e-3)), 2.0)
    return np.array([1.0, np.log(pixels / 300.0), np.log(deviation / 1e-3), np.log(turn / 0.02), fit.explained, apart])


CONFIDENCE_WEIGHTS = np.array([0.0, 0.5, -0.5, -0.5, 4.0, 0.5])
"""Of :func:`features_of`, by logistic regression on renders of robots that are neither learnt from nor judged by."""


def _possible(fit: Fit) -> bool:
    x, y, z = fit.position_m
    return bool(np.hypot(x, y) < FARTHEST_M and -0.02 < z < HIGHEST_M)
