"""A tracker as on the real robot: colours, a sample of pixels, a global search without memory, and a confidence.

It is there to compare with (trifinger_object_tracking @78ec981, read from its source), not for use on a farm.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration
from sim_backend.vision.colours import segmented
from sim_backend.vision.image_tracker import SeenPose
from sim_backend.vision.pose_search import SAMPLED_PIXELS, PixelRays, distances_px, searched
from sim_backend.vision.rotations import quat_of_matrix

FEWEST_PIXELS = 30
"""Coloured pixels over all cameras below which nothing is searched."""
RIGHT_WITHIN_PX = 1.5
"""A pixel no farther from its face counts as explained."""
_SHARES = (0.4, 0.3, 0.3)
"""Weights of pixels explained, faces filled and cameras that see any (pose_detector.cpp)."""
_SEEN_PX = 20


def track_by_colours(
    images: np.ndarray | Sequence[np.ndarray],
    calibrations: Sequence[Calibration],
    *,
    seed: int = 0,
    width_m: float = c.TRACKED_CUBE_WIDTH_M,
) -> SeenPose:
    """Where the cube is.

    Args:
        images: one of each camera, shape (height, width, 3), uint8, red first.
        calibrations: of the cameras, for images of these sizes.
        seed: of the sampling and the search; the same seed gives the same pose.
        width_m: of the cube.
    """
    return track_masks([segmented(image) for image in images], calibrations, seed=seed, width_m=width_m)


def track_masks(
    masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], *, seed: int = 0, width_m: float = c.TRACKED_CUBE_WIDTH_M
) -> SeenPose:
    """Where the cube is, from classes of pixels, each shape (height, width); arguments as for :func:`track_by_colours`."""
    rng = np.random.default_rng(seed)
    faces = np.array([[(mask == face + 1).sum() >= _SEEN_PX for face in range(6)] for mask in masks])
    rays = sampled(masks, calibrations, rng, SAMPLED_PIXELS)
    unknown = np.full((6, 6), np.nan)
    if not rays or sum(int((mask > 0).sum()) for mask in masks) < FEWEST_PIXELS:
        return SeenPose(np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0, 0.0]), unknown, 0.0, faces)
    position_m, rotation, _ = searched(rays, rng, width_m)
    confidence = confidence_of(masks, calibrations, position_m, rotation, width_m)
    return SeenPose(position_m, rotation, quat_of_matrix(rotation), unknown, confidence, faces)


def sampled(
    masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], rng: np.random.Generator, most: int | None
) -> list[PixelRays]:
    """Coloured pixels of all cameras, at most so many, drawn alike from all; cameras that see none are left out."""
    places = [np.argwhere(mask > 0) for mask in masks]
    total = sum(len(each) for each in places)
    kept = []
    for mask, camera, found in zip(masks, calibrations, places, strict=True):
        wanted = len(found) if most is None or total <= most else round(most * len(found) / total)
        if wanted:
            drawn = found[rng.choice(len(found), wanted, replace=False)]
            face = mask[drawn[:, 0], drawn[:, 1]].astype(int) - 1
            kept.append(PixelRays(camera, camera.normalised(drawn[:, ::-1].astype(float)), face))
    return kept


def confidence_of(
    masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], position_m: np.ndarray, rotation: np.ndarray, width_m: float
) -> float:
    """How well a pose explains the classes of pixels, from 0 to 1: pixels explained, faces filled, cameras that see any."""
    right, total, filled, cameras = 0, 0, [], 0
    for mask, camera in zip(masks, calibrations, strict=True):
        cameras += bool((mask > 0).any())
        near = _window(mask, camera, position_m, width_m)
        grid = np.stack(np.meshgrid(near[1], near[0]), axis=-1).reshape(-1, 2)
        shown = mask[grid[:, 1], grid[:, 0]]
        every = camera.normalised(grid.astype(float))
        total += int((mask > 0).sum())
        for face in range(6):
            rays = PixelRays(camera, every, np.full(len(every), face))
            distance, looks = distances_px(rays, position_m[None], rotation[None], width_m)
            of_face = shown == face + 1
            right += int((of_face & (distance[0] <= RIGHT_WITHIN_PX) & looks[0]).sum())
            inside = (distance[0] == 0.0) & looks[0]
            if inside.any():
                filled.append((int(inside.sum()), float((of_face & inside).sum() / inside.sum())))
    weight = np.array([size for size, _ in filled] or [1.0])
    filled_share = float((weight * np.array([share for _, share in filled] or [0.0])).sum() / weight.sum())
    return float(np.dot(_SHARES, (right / max(total, 1), filled_share, cameras / len(masks))))


def _window(mask: np.ndarray, camera: Calibration, position_m: np.ndarray, width_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of an image that the cube at a position can reach."""
    depth = max(float(camera.to_camera(position_m)[2]), width_m)
    reach = 1.0 + width_m / depth * camera.focal_px[0]
    column, row = np.nan_to_num(camera.project(position_m), nan=-1e6)
    return tuple(  # pyrefly: ignore[bad-return]
        np.arange(int(np.clip(at - reach, 0, size)), int(np.clip(at + reach, 0, size)))
        for at, size in zip((row, column), mask.shape, strict=True)
    )
