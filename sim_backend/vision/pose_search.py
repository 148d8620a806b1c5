"""The pose of a cube from coloured pixels: a global search without memory, as the real tracker makes it.

For each pose the pixels' distances to the projected face of their colour are summed over all cameras; faces that would have to be
seen through the cube cost more, and so do poses below the floor (trifinger_object_tracking @78ec981, pose_detector.cpp).
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.vision.calibration import Calibration
from sim_backend.vision.rotations import matrices_of
from sim_backend.vision.seen_pixels import FACES

FARTHEST_M = 0.35
"""From the world's origin, along each axis."""
POPULATION, GENERATIONS = 40, 50
SAMPLED_PIXELS = 150
HIDDEN_FACE_PX = 30.0
"""Added to the distance of a pixel whose face looks away from the camera."""
UNDER_FLOOR_PX_PER_M = 2000.0
"""Per pixel: a cube that lies 1 mm deep in the floor costs as much as 2 px at each."""
_FOLLOWING = (1, 2, 3, 0)
"""A face's corners, the next of each."""


@dataclass(frozen=True)
class PixelRays:
    """Coloured pixels of one camera: ``direction`` (n, 2) are x/z and y/z, ``face`` (n,) is which of the six they show."""

    camera: Calibration
    direction: np.ndarray
    face: np.ndarray


@functools.lru_cache(maxsize=64)
def face_corners_m(width_m: float) -> np.ndarray:
    """Corners of the six faces in the cube's frame, shape (6, 4, 3), m, in order around each."""
    corners = []
    for face in FACES:
        axis, sign = "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0
        square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
        points = np.empty((4, 3))
        points[:, axis], points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = sign, sign * square[:, 0], square[:, 1]
        corners.append(points * width_m / 2)
    found = np.array(corners)
    found.flags.writeable = False  # all who ask get the same
    return found


def distances_px(rays: PixelRays, position_m: np.ndarray, rotation: np.ndarray, width_m: float) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel lies outside of the face of its colour, for p poses.

    Args:
        rays: n pixels of one camera.
        position_m: of the cube in the world, shape (p, 3).
        rotation: of the cube, shape (p, 3, 3).
        width_m: of the cube.

    Returns:
        Distances in pixels of the camera, 0 inside, and whether the face looks at the camera; both (p, n).
    """
    corners = face_corners_m(width_m)
    world = np.einsum("pij,fkj->pfki", rotation, corners) + position_m[:, None, None]
    seen = rays.camera.to_camera(world)
    flat = seen[..., :2] / np.maximum(seen[..., 2:], 1e-3)
    following = flat[:, :, _FOLLOWING]
    along = following - flat
    area = 0.5 * (flat[..., 0] * following[..., 1] - following[..., 0] * flat[..., 1]).sum(axis=2)
    looks = area < 0.0  # corners go round against the clock as seen from outside; y points down in an image
    sign = np.where(area < 0.0, -1.0, 1.0)[..., None]
    normal = np.stack([along[..., 1], -along[..., 0]], axis=-1) * sign[..., None]
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    offset = (normal * flat).sum(axis=-1)
    of_face, of_offset = normal[:, rays.face], offset[:, rays.face]
    outside = (of_face * rays.direction[None, :, None]).sum(axis=-1) - of_offset
    distance = np.maximum(outside.max(axis=-1), 0.0) * (sum(rays.camera.focal_px) / 2)
    return distance, looks[:, rays.face]


def cost_px(pose: np.ndarray, rays: Sequence[PixelRays], width_m: float) -> np.ndarray:
    """Root of the mean squared distance over all pixels, for p poses, shape (p,).

    Args:
        pose: position in m, then rotation vector in rad, shape (p, 6).
        rays: the pixels of all cameras.
        width_m: of the cube.
    """
    position_m, rotation = pose[:, :3], matrices_of(pose[:, 3:])
    total, count = np.zeros(len(pose)), 0
    for each in rays:
        distance, looks = distances_px(each, position_m, rotation, width_m)
        total += np.square(distance + HIDDEN_FACE_PX * ~looks).sum(axis=1)
        count += len(each.face)
    lowest_m = position_m[:, 2] - width_m / 2 * np.abs(rotation[:, 2]).sum(axis=1)
    return np.sqrt(total / max(count, 1)) + UNDER_FLOOR_PX_PER_M * np.maximum(-lowest_m, 0.0)


def searched(rays: Sequence[PixelRays], rng: np.random.Generator, width_m: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The best pose that differential evolution finds: position (3,), m, rotation (3, 3), and its cost, px."""
    from scipy.optimize import differential_evolution

    far = (-FARTHEST_M, FARTHEST_M)
    bounds = [far, far, (0.0, FARTHEST_M), *([(-np.pi, np.pi)] * 3)]
    low, high = np.array(bounds).T
    found = differential_evolution(
        lambda population: cost_px(population.T, rays, width_m),
        bounds,
        init=rng.uniform(low, high, (POPULATION, 6)),
        maxiter=GENERATIONS,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=rng,
    )
    return found.x[:3], matrices_of(found.x[None, 3:])[0], float(found.fun)
