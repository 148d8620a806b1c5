"""A camera's calibration: where a point of the world lands in its image, and where its pixels look."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_backend.trifinger import constants as c

_UNDISTORTION_STEPS = 20
"""Fixed-point steps of :meth:`Calibration.normalised`; at these lenses each leaves about a quarter of the error."""
_AT_ONCE = 4096
"""Pixels whose steps are taken together: more do not fit into a core's cache."""


@dataclass(frozen=True)
class Calibration:
    """A pinhole camera with the lens of Brown and Conrady, as OpenCV writes it; pixels are counted from centre to centre.

    Attributes:
        name: of the camera.
        size_px: width and height of its images.
        focal_px: along x and y.
        centre_px: of the optical axis, x and y.
        distortion: k1, k2, p1, p2, k3, shape (5,).
        rotation: from the world to the camera, shape (3, 3); x to the right, y down, z forward.
        translation_m: shape (3,): a point p of the world is at ``rotation @ p + translation_m``.
    """

    name: str
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """The pinhole's matrix, shape (3, 3)."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def position_world_m(self) -> np.ndarray:
        """Where the camera stands, shape (3,)."""
        return -self.rotation.T @ self.translation_m

    def to_camera(self, points_world_m: np.ndarray) -> np.ndarray:
        """Points of the world, shape (..., 3), in the camera's frame."""
        return points_world_m @ self.rotation.T + self.translation_m

    def project(self, points_world_m: np.ndarray) -> np.ndarray:
        """Where points of the world, shape (..., 3), land in the image, shape (..., 2), px; NaN for those behind the camera."""
        points = self.to_camera(np.asarray(points_world_m, dtype=float))
        depth = np.where(points[..., 2:] > 0.0, points[..., 2:], np.nan)
        return self.pixels(points[..., :2] / depth)

    def pixels(self, normalised: np.ndarray) -> np.ndarray:
        """Pixels, shape (..., 2), of directions x/z and y/z in the camera's frame, shape (..., 2)."""
        return distorted(normalised, self.distortion) * self.focal_px + self.centre_px

    def normalised(self, pixels: np.ndarray) -> np.ndarray:
        """Directions x/z and y/z, shape (..., 2), that land on pixels of shape (..., 2): the inverse of :meth:`pixels`."""
        every = ((np.asarray(pixels, dtype=float) - self.centre_px) / self.focal_px).reshape(-1, 2)
        found = np.empty_like(every)
        for first in range(0, len(every), _AT_ONCE):
            seen = direction = every[first : first + _AT_ONCE]
            for _ in range(_UNDISTORTION_STEPS):
                direction = direction + seen - distorted(direction, self.distortion)
            found[first : first + _AT_ONCE] = direction
        return found.reshape(np.shape(pixels))

    def looked_up(self, pixels: np.ndarray) -> np.ndarray:
        """As :meth:`normalised`, and the same bits: whole pixels of the image, shape (n, 2), have theirs in a table."""
        column, row = pixels.astype(int).T
        width, height = self.size_px
        known = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (column == pixels[:, 0]) & (row == pixels[:, 1])
        return self._directions[row, column] if known.all() else self.normalised(pixels)

    @functools.cached_property
    def _directions(self) -> np.ndarray:
        """What :meth:`normalised` gives of each pixel, shape (height, width, 2)."""
        width, height = self.size_px
        return self.normalised(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))

    def resized(self, size_px: int) -> "Calibration":
        """The same camera with square images of another size, each of whose pixels is a mean of the present ones."""
        factor = size_px / self.size_px[0]
        centre = (factor * (self.centre_px[0] + 0.5) - 0.5, factor * (self.centre_px[1] + 0.5) - 0.5)
        focal = (factor * self.focal_px[0], factor * self.focal_px[1])
        return replace(self, size_px=(size_px, round(factor * self.size_px[1])), focal_px=focal, centre_px=centre)


def distorted(normalised: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """What the lens makes of directions x/z and y/z, both of shape (..., 2) (OpenCV's five coefficients)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = normalised[..., 0], normalised[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    along_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    along_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([along_x, along_y], axis=-1)


def nominal_calibrations() -> tuple[Calibration, ...]:
    """The three cameras as their calibration files have them, for images of 270 x 270: what a user of a robot is given."""
    return tuple(
        Calibration(
            name=camera.name,
            size_px=(c.CAMERA_IMAGE_PX, c.CAMERA_IMAGE_PX),
            focal_px=(fx, fy),
            centre_px=(cx, cy),
            distortion=np.array(distortion),
            rotation=np.array(pose)[:, :3],
            translation_m=np.array(pose)[:, 3],
        )
        for camera, pose, ((fx, fy, cx, cy), distortion) in zip(c.CAMERAS, c.CAMERA_POSES, c.CAMERA_LENSES, strict=True)
    )


def calibration_of(document: Mapping[str, Any]) -> Calibration:
    """A calibration as the files of the real robot hold it (``camera_calib_*.yml``).

    Raises:
        ValueError: something is missing or has another shape; the message says what.
    """
    try:
        matrix = np.array(document["camera_matrix"]["data"], dtype=float).reshape(3, 3)
        pose = np.array(document["tf_world_to_camera"]["data"], dtype=float).reshape(4, 4)
        return Calibration(
            name=str(document["camera_name"]),
            size_px=(int(document["image_width"]), int(document["image_height"])),
            focal_px=(matrix[0, 0], matrix[1, 1]),
            centre_px=(matrix[0, 2], matrix[1, 2]),
            distortion=np.array(document["distortion_coefficients"]["data"], dtype=float).reshape(5),
            rotation=pose[:3, :3],
            translation_m=pose[:3, 3],
        )
    except KeyError as error:
        raise ValueError(f"the calibration has no {error.args[0]!r}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"the calibration cannot be read: {error}") from error
