"""The pose of a box that explains where pixels of calibrated cameras say they are on it: robust least squares over all views.

Each pixel is a ray in the world and a point in the box's frame. A pose is the better the nearer it brings the points to their
rays. From 24 starts, the turns of a cube, points are brought to their rays and the turn is read from them (orthogonal iteration,
Lu, Hager and Mjolsness 2000, for rays of several cameras); the best ones are refined by Gauss-Newton steps with Cauchy's weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.vision.calibration import Calibration
from sim_backend.vision.rotations import matrices_of
from sim_backend.vision.seen_pixels import SeenPixels

ROUGH_PIXELS = 160
"""Drawn for the search from all starts."""
ROUGH_STEPS, FINE_STEPS, REFINED = 10, 8, 3
INLIER = 3.0
"""In expected errors: pixels farther from their rays are not explained, and Cauchy's weight of such a one is a tenth."""
LEAST_ERROR_M = 0.001
"""Of a pixel's place, whatever the network says."""


@dataclass(frozen=True)
class Rays:
    """Pixels as rays in the world, all cameras together.

    Attributes:
        eye_m: where they begin, shape (n, 3).
        direction: of length one, shape (n, 3).
        point_m: of the box, in its frame, that they should meet, shape (n, 3).
        error_m: expected of that, shape (n,).
        camera: which camera's they are, shape (n,).
    """

    eye_m: np.ndarray
    direction: np.ndarray
    point_m: np.ndarray
    error_m: np.ndarray
    camera: np.ndarray

    def rows(self, index: np.ndarray) -> "Rays":
        """Some of them."""
        return Rays(self.eye_m[index], self.direction[index], self.point_m[index], self.error_m[index], self.camera[index])


@dataclass(frozen=True)
class Fit:
    """A pose: position (3,) in m, rotation (3, 3); its cost, the share of rays it explains, and the covariance (6, 6).

    The covariance is of position in m and of the rotation vector in the world's frame in rad, as if pixels erred independently.
    """

    position_m: np.ndarray
    rotation: np.ndarray
    cost: float
    explained: float
    covariance: np.ndarray


def rays_of(seen: Sequence[SeenPixels], calibrations: Sequence[Calibration], half_m: np.ndarray) -> Rays:
    """The pixels of all cameras.

    Args:
        seen: of each camera.
        calibrations: of the cameras.
        half_m: half the box's extents, shape (3,).
    """
    eyes, directions, cameras = [], [], []
    for index, (pixels, calibration) in enumerate(zip(seen, calibrations, strict=True)):
        flat = calibration.looked_up(pixels.pixel)
        along = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
        directions.append(along / np.linalg.norm(along, axis=1, keepdims=True) @ calibration.rotation)
        eyes.append(np.broadcast_to(calibration.position_world_m, (len(flat), 3)))
        cameras.append(np.full(len(flat), index))
    place = np.concatenate([each.place for each in seen]) * half_m
    error = np.concatenate([each.expected_error for each in seen]) * float(np.mean(half_m))
    return Rays(
        np.concatenate(eyes), np.concatenate(directions), place, np.maximum(error, LEAST_ERROR_M), np.concatenate(cameras)
    )


def turns_of_cube() -> np.ndarray:
    """The 24 rotations that bring a cube onto itself, shape (24, 3, 3)."""
    turns = []
    for first in range(3):
        for second in range(3):
            if first != second:
                for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                    x, y = signs[0] * np.eye(3)[first], signs[1] * np.eye(3)[second]
                    turns.append(np.stack([x, y, np.cross(x, y)], axis=1))
    return np.array(turns)


_TURNS = turns_of_cube()
_TILT = matrices_of(np.array([[0.35, 0.2, 0.3]]))[0]
"""Away from the axes, so that no start lies just between two solutions for a box on the floor."""


def fitted(rays: Rays, rng: np.random.Generator, starts: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> list[Fit]:
    """Poses that explain the rays, the best first; further ones are others, not the same again.

    Args:
        rays: at least six, in no degenerate arrangement.
        rng: which of them are looked at in the search.
        starts: poses to begin with besides those of the search: positions (3,) and rotations (3, 3).
    """
    few = rays.rows(_drawn(rays, rng))
    rotation, position, cost = _searched(few, _TURNS @ _TILT)
    best = np.argsort(cost)[:REFINED]
    begun = [*starts, *((position[k], rotation[k]) for k in best)]
    fits = sorted((refined(rays, *start) for start in begun), key=lambda fit: fit.cost)
    kept: list[Fit] = []
    for fit in fits:
        if all(_differ(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _differ(one: Fit, other: Fit) -> bool:
    return bool(np.trace(one.rotation.T @ other.rotation) < 2.9 or np.linalg.norm(one.position_m - other.position_m) > 0.01)


def _drawn(rays: Rays, rng: np.random.Generator) -> np.ndarray:
    """Rows of at most ``ROUGH_PIXELS`` rays, likelier those of small expected errors."""
    n = len(rays.error_m)
    if n <= ROUGH_PIXELS:
        return np.arange(n)
    chance = 1.0 / rays.error_m
    return rng.choice(n, ROUGH_PIXELS, replace=False, p=chance / chance.sum())


def _searched(rays: Rays, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orthogonal iteration from rotations (p, 3, 3): rotations, positions (p, 3) and costs (p,) that they come to."""
    across = np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :]
    weight = np.broadcast_to(1.0 / rays.error_m**2, (len(rotation), len(rays.error_m)))
    position = np.zeros((len(rotation), 3))
    ratio = np.zeros(weight.shape)
    for step in range(ROUGH_STEPS):
        turned = rays.point_m @ rotation.transpose(0, 2, 1)
        matrix = np.einsum("pn,nij->pij", weight, across)
        pull = np.einsum("pn,nij,pnj->pi", weight, across, rays.eye_m - turned)
        position = np.linalg.solve(matrix, pull[..., None])[..., 0]
        away = turned + position[:, None] - rays.eye_m
        off = np.einsum("nij,pnj->pni", across, away)
        ratio = (off**2).sum(axis=-1) / rays.error_m**2
        weight = 1.0 / (rays.error_m**2 * (1.0 + ratio / INLIER**2))
        if step < ROUGH_STEPS - 1:
            target = away + rays.eye_m - off
            total = weight.sum(axis=1)[:, None]
            mean_point = np.einsum("pn,ni->pi", weight, rays.point_m) / total
            mean_target = np.einsum("pn,pni->pi", weight, target) / total
            moment = np.einsum(
                "pn,pni,pnj->pij", weight, target - mean_target[:, None], rays.point_m - mean_point[:, None], optimize=True
            )
            left, _, right = np.linalg.svd(moment)
            left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
            rotation = left @ right
    return rotation, position, np.log1p(ratio / INLIER**2).mean(axis=1)


def refined(rays: Rays, position_m: np.ndarray, rotation: np.ndarray) -> Fit:
    """The pose that Gauss-Newton steps come to from a start."""
    across = np.eye(3) - rays.direction[:, :, None] * rays.direction[:, None, :]
    cost, scale = np.inf, 1e-9 * np.eye(6)
    best: Fit | None = None
    for _ in range(FINE_STEPS):
        turned = rays.point_m @ rotation.T
        off = np.einsum("nij,nj->ni", across, turned + position_m - rays.eye_m)
        ratio = (off**2).sum(axis=1) / rays.error_m**2
        before, cost = cost, float(np.log1p(ratio / INLIER**2).mean())
        weight = 1.0 / (rays.error_m**2 * (1.0 + ratio / INLIER**2))
        slope = np.concatenate([np.broadcast_to(np.eye(3), (len(turned), 3, 3)), -_crosses(turned)], axis=2)
        seen = across @ slope
        normal = np.einsum("n,nki,nkj->ij", weight, seen, seen, optimize=True) + scale
        if best is None or cost < best.cost:
            best = Fit(position_m, rotation, cost, float((ratio < INLIER**2).mean()), np.linalg.inv(normal))
        if before - cost < 1e-5:
            break
        step = np.linalg.solve(normal, -np.einsum("n,nki,nk->i", weight, seen, off))
        position_m, rotation = position_m + step[:3], matrices_of(step[None, 3:])[0] @ rotation
    assert best is not None, "there is a first step"
    return best


def _crosses(vectors: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) whose product with a vector is the cross product of vectors (n, 3) with it."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
