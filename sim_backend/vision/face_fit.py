"""Sharpens a pose by the faces' outlines: pixels of a face must lie within its projection, and none may look through the cube.

Places on the cube tell a pose from far away, outlines tell it from near: damped Gauss-Newton steps on how far pixels lie outside
of the faces that they show.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.vision.calibration import Calibration
from sim_backend.vision.pose_search import PixelRays, distances_px
from sim_backend.vision.rotations import matrices_of
from sim_backend.vision.seen_pixels import SeenPixels

MOST_PIXELS = 400
STEPS = 10
_TINY = np.array([2e-4, 2e-4, 2e-4, 2e-3, 2e-3, 2e-3])
"""Changes of position, m, and turn, rad, by which slopes are measured."""
_FAR_PX = 4.0
"""Pixels this far outside are counted as wrong, not as a reason to move."""
_AWAY_PX = 6.0
"""What a pixel counts whose face looks away from its camera."""
_UNDER_FLOOR_PX_PER_M = 1000.0
"""A cube that lies 1 mm deep in the floor counts as 1 px at each pixel: nothing lies there, whatever the calibration says."""


def sharpened(
    position_m: np.ndarray,
    rotation: np.ndarray,
    seen: Sequence[SeenPixels],
    calibrations: Sequence[Calibration],
    width_m: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float]:
    """The pose that outlines lead to from a near one.

    Args:
        position_m: to begin with, shape (3,).
        rotation: to begin with, shape (3, 3).
        seen: pixels of each camera.
        calibrations: of the cameras.
        width_m: of the cube.
        rng: which pixels are looked at.

    Returns:
        Position, rotation, and the root of the pixels' mean squared distance, px, far ones cut off.
    """
    rays = _drawn(seen, calibrations, rng)
    damping, (distance, cost) = 1e-2, _misfit(position_m[None], rotation[None], rays, width_m)
    for _ in range(STEPS):
        moved = position_m + np.vstack([np.diag(_TINY[:3]), np.zeros((3, 3))])
        turned = matrices_of(np.vstack([np.zeros((3, 3)), np.diag(_TINY[3:])])) @ rotation
        slope = (_misfit(moved, turned, rays, width_m)[0] - distance) / _TINY[:, None]
        counts = distance[0] < _FAR_PX
        counts[-1] = True
        slope = np.where(counts, slope, 0.0)
        normal = slope @ slope.T
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), -slope @ distance[0])
        there, facing = position_m + step[:3], matrices_of(step[None, 3:])[0] @ rotation
        tried, tried_cost = _misfit(there[None], facing[None], rays, width_m)
        if tried_cost[0] < cost[0]:
            gained = cost[0] - tried_cost[0]
            position_m, rotation, distance, cost, damping = there, facing, tried, tried_cost, damping / 4
            if gained < 1e-4 * cost[0]:
                break
        else:
            damping *= 8
    return position_m, rotation, float(np.sqrt(np.square(np.minimum(distance[0, :-1], _FAR_PX)).mean()))


def _drawn(seen: Sequence[SeenPixels], calibrations: Sequence[Calibration], rng: np.random.Generator) -> list[PixelRays]:
    total, kept = sum(len(pixels.face) for pixels in seen), []
    for pixels, calibration in zip(seen, calibrations, strict=True):
        count = len(pixels.face)
        if count:
            rows = (
                np.arange(count) if total <= MOST_PIXELS else rng.choice(count, -(-MOST_PIXELS * count // total), replace=False)
            )
            kept.append(PixelRays(calibration, calibration.looked_up(pixels.pixel[rows]), pixels.face[rows]))
    return kept


def _misfit(
    position_m: np.ndarray, rotation: np.ndarray, rays: Sequence[PixelRays], width_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """As :func:`_distance`, and at the end of each row how deep the cube lies in the floor, in px for all pixels together."""
    distance, cost = _distance(position_m, rotation, rays, width_m)
    lowest_m = position_m[:, 2] - width_m / 2 * np.abs(rotation[:, 2]).sum(axis=1)
    depth_px = _UNDER_FLOOR_PX_PER_M * np.maximum(-lowest_m, 0.0)
    deep = depth_px * np.sqrt(distance.shape[1])
    return np.concatenate([distance, deep[:, None]], axis=1), cost + depth_px**2


def _distance(
    position_m: np.ndarray, rotation: np.ndarray, rays: Sequence[PixelRays], width_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel lies outside of its face at p poses, shape (p, n), px, and the mean square, far ones cut off, (p,)."""
    found = []
    for each in rays:
        distance, looks = distances_px(each, position_m, rotation, width_m)
        found.append(distance + _AWAY_PX * ~looks)
    distance = np.concatenate(found, axis=1)
    return distance, np.square(np.minimum(distance, _FAR_PX)).mean(axis=1)
