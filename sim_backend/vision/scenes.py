"""Scenes for trackers to learn from and to be judged by: cubes on the floor and in the air, fingers at them and elsewhere."""

from dataclasses import dataclass

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import elbow_position_world_m, fingertip_position_world_m, joint_position_rad
from sim_backend.vision.rotations import matrix_of_quat, multiplied

HIGHEST_M = 0.15
"""Of the cube's centre; goals go up to 0.1 m."""
_AT_CUBE, _ANYWHERE = 0.6, 0.25
"""Shares of scenes whose fingers are at the cube, and anywhere; in the others they are near their start."""
_GAP_M = 0.03
"""How far from the cube's surface a finger at the cube may be."""
_TRIES = 12
_ALONG = np.linspace(0.0, 1.0, 8)[:, None]
"""Where along a lower link it is looked whether it goes through the cube."""


@dataclass(frozen=True)
class Scene:
    """Joint positions (9,) in rad, and the cube's pose: (3,) in m and (4,) wxyz."""

    joint_position_rad: np.ndarray
    position_world_m: np.ndarray
    quat_wxyz: np.ndarray


def drawn_scene(rng: np.random.Generator) -> Scene:
    """A scene: half of the cubes lie on the floor with any face up, half are in the air and turned any way."""
    radius, angle = c.MAX_CUBE_CENTRE_DISTANCE_M * np.sqrt(rng.random()), rng.uniform(-np.pi, np.pi)
    quat, height = rng.standard_normal(4), rng.uniform(c.CUBE_RADIUS_M, HIGHEST_M)
    if rng.random() < 0.5:
        quat, height = resting_quat(int(rng.integers(6)), rng.uniform(-np.pi, np.pi)), c.CUBE_REST_HEIGHT_M
    quat = quat / np.linalg.norm(quat)
    position = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    return Scene(_fingers(rng, position, matrix_of_quat(quat)), position, quat)


def resting_quat(face: int, yaw_rad: float) -> np.ndarray:
    """The orientation (4,) wxyz of a cube on the floor with a face of ``CUBE_FACE_COLOURS`` up, turned about the vertical."""
    half = np.sqrt(0.5)
    up = [
        (half, 0, -half, 0),
        (half, 0, half, 0),
        (half, half, 0, 0),
        (half, -half, 0, 0),
        (1, 0, 0, 0),
        (0, 1, 0, 0),
    ][face]
    yaw = np.array([np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)])
    return multiplied(yaw, np.array(up, dtype=float))


def _fingers(rng: np.random.Generator, position_m: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    kind = rng.random()
    joints = c.START_JOINT_POSITION_RAD + rng.normal(0.0, 0.15, 9)
    if kind < _AT_CUBE + _ANYWHERE:
        joints = _drawn_apart(rng, position_m, rotation)
    if kind < _AT_CUBE:
        for finger in np.flatnonzero(rng.random(3) < 0.85):
            found = _finger_at(rng, int(finger), position_m, rotation)
            if found is not None:
                joints[3 * finger : 3 * finger + 3] = found
    return np.clip(joints, c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD)


def _drawn_apart(rng: np.random.Generator, position_m: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Joint positions anywhere within the limits, of fingers that do not go through the cube where a few tries find them."""
    drawn = rng.uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD, (_TRIES, 9))
    free = _free(drawn, position_m, rotation)
    first = np.argmax(free, axis=0)
    return np.concatenate([drawn[first[finger], 3 * finger : 3 * finger + 3] for finger in range(3)])


def _finger_at(rng: np.random.Generator, finger: int, position_m: np.ndarray, rotation: np.ndarray) -> np.ndarray | None:
    """Joint positions (3,) of a finger whose tip is at the cube; None where a few tries find none."""
    half = c.CUBE_WIDTH_M / 2
    place = rng.uniform(-half, half, (_TRIES, 3))
    rows, axis, sign = np.arange(_TRIES), rng.integers(3, size=_TRIES), rng.choice([-1.0, 1.0], _TRIES)
    place[rows, axis] = sign * (half + c.TIP_RADIUS_M + rng.uniform(0.0, _GAP_M, _TRIES))
    tips = place @ rotation.T + position_m
    joints = joint_position_rad(np.tile(tips, (1, 3)))
    own = slice(3 * finger, 3 * finger + 3)
    low, high = c.SOFT_LIMIT_LOWER_RAD[own], c.SOFT_LIMIT_UPPER_RAD[own]
    with np.errstate(invalid="ignore"):
        fits = ((joints[:, own] >= low) & (joints[:, own] <= high)).all(axis=1) & (tips[:, 2] > c.TIP_RADIUS_M)
    fits &= _free(np.nan_to_num(joints), position_m, rotation)[:, finger]
    return joints[np.argmax(fits), own] if fits.any() else None


def _free(joints: np.ndarray, position_m: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Whether the lower links of fingers at joint positions (n, 9) stay out of the cube and above the floor, shape (n, 3)."""
    tip, elbow = (at(joints).reshape(-1, 3, 1, 3) for at in (fingertip_position_world_m, elbow_position_world_m))
    along = tip + _ALONG * (elbow - tip)
    outside = np.abs((along - position_m) @ rotation) - c.CUBE_WIDTH_M / 2
    distance = np.linalg.norm(np.maximum(outside, 0.0), axis=-1).min(axis=-1)
    return (distance > 0.8 * c.TIP_STEM_RADIUS_M) & (along[..., 2].min(axis=-1) > 0.5 * c.TIP_RADIUS_M)
