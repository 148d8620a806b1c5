"""A tracker on images as on the real robot: colours, a sample of pixels, a global search without memory, and a confidence.

It is a reference to compare with, not the best that can be done; ``track`` is all there is to call.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration
from sim_backend.vision.colours import segmented
from sim_backend.vision.pose_search import SAMPLED_PIXELS, Rays, distances_px, searched

FEWEST_PIXELS = 30
"""Coloured pixels over all cameras below which nothing is searched."""
RIGHT_WITHIN_PX = 1.5
"""A pixel no farther from its face counts as explained."""
_SHARES = (0.4, 0.3, 0.3)
"""Weights of pixels explained, faces filled and cameras that see any (trifinger_object_tracking, pose_detector.cpp)."""


@dataclass(frozen=True)
class SeenPose:
    """A pose of the cube found in images: position (3,) in m, orientation (3, 3) and (4,) wxyz, confidence from 0 to 1.

    Without enough coloured pixels there is none: ``confidence`` is 0 then, and the numbers mean nothing.
    """

    position_world_m: np.ndarray
    rotation: np.ndarray
    quat_wxyz: np.ndarray
    confidence: float


def track(
    images: np.ndarray | Sequence[np.ndarray],
    calibration: Sequence[Calibration],
    *,
    seed: int = 0,
    width_m: float = c.TRACKED_CUBE_WIDTH_M,
) -> SeenPose:
    """Where the cube is.

    Args:
        images: one of each camera, shape (height, width, 3), uint8, red first.
        calibration: of the cameras, for images of these sizes.
        seed: of the sampling and the search; the same seed gives the same pose.
        width_m: of the cube.
    """
    return track_masks([segmented(image) for image in images], calibration, seed=seed, width_m=width_m)


def track_masks(
    masks: Sequence[np.ndarray], calibration: Sequence[Calibration], *, seed: int = 0, width_m: float = c.TRACKED_CUBE_WIDTH_M
) -> SeenPose:
    """Where the cube is, from classes of pixels, each shape (height, width); arguments as for :func:`track`."""
    rng = np.random.default_rng(seed)
    rays = sampled(masks, calibration, rng, SAMPLED_PIXELS)
    if not rays or sum(int((mask > 0).sum()) for mask in masks) < FEWEST_PIXELS:
        return SeenPose(np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0, 0.0]), 0.0)
    position_m, rotation, _ = searched(rays, rng, width_m)
    confidence = confidence_of(masks, calibration, position_m, rotation, width_m)
    return SeenPose(position_m, rotation, quat_of(rotation), confidence)


def sampled(
    masks: Sequence[np.ndarray], calibration: Sequence[Calibration], rng: np.random.Generator, most: int | None
) -> list[Rays]:
    """Coloured pixels of all cameras, at most so many, drawn alike from all; cameras that see none are left out."""
    places = [np.argwhere(mask > 0) for mask in masks]
    total = sum(len(each) for each in places)
    kept = []
    for mask, camera, found in zip(masks, calibration, places, strict=True):
        wanted = len(found) if most is None or total <= most else round(most * len(found) / total)
        if wanted:
            drawn = found[rng.choice(len(found), wanted, replace=False)]
            face = mask[drawn[:, 0], drawn[:, 1]].astype(int) - 1
            kept.append(Rays(camera, camera.normalised(drawn[:, ::-1].astype(float)), face))
    return kept


def confidence_of(
    masks: Sequence[np.ndarray], calibration: Sequence[Calibration], position_m: np.ndarray, rotation: np.ndarray, width_m: float
) -> float:
    """How well a pose explains the classes of pixels, from 0 to 1: pixels explained, faces filled, cameras that see any."""
    right, total, filled, cameras = 0, 0, [], 0
    for mask, camera in zip(masks, calibration, strict=True):
        grid = np.argwhere(mask >= 0)
        every = camera.normalised(grid[:, ::-1].astype(float))
        coloured = mask.ravel() > 0
        cameras += bool(coloured.any())
        for face in range(6):
            distance, looks = distances_px(
                Rays(camera, every, np.full(len(every), face)), position_m[None], rotation[None], width_m
            )
            of_face = mask.ravel() == face + 1
            explained = of_face & (distance[0] <= RIGHT_WITHIN_PX) & looks[0]
            right, total = right + int(explained.sum()), total + int(of_face.sum())
            inside = (distance[0] == 0.0) & looks[0]
            if inside.any():
                filled.append((int(inside.sum()), float((of_face & inside).sum() / inside.sum())))
    weight = np.array([size for size, _ in filled] or [1.0])
    filled_share = float((weight * np.array([share for _, share in filled] or [0.0])).sum() / weight.sum())
    return float(np.dot(_SHARES, (right / max(total, 1), filled_share, cameras / len(masks))))


def quat_of(rotation: np.ndarray) -> np.ndarray:
    """The quaternion (4,) wxyz of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
