"""Stretches of a log in which one finger pushes a resting cube: what happened, and where the cube lay before."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.recording import ObjectSignals, Recording
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m

BEFORE_S, LENGTH_S = 0.12, 0.66
"""A window begins so long before the tip comes near the cube, and is so long."""
LEAST_PUSHES = 4
"""With fewer the excitation is to be recorded again."""
NEAR_M = 0.004
_LOW_M = 0.06  # a tip below this is beside the cube
_FLAT = 0.97  # cosine between an axis of a cube that lies flat and the vertical
_HEIGHT_M = 0.012  # how far from its resting height a cube on the table may be seen
_SETTLED_S = 0.4  # a cube that was pushed has come to rest
_LEAST_FRAMES = 4
_OUTLIER_M = 0.02


@dataclass(frozen=True)
class PushWindow:
    """One push, in steps of 1 ms.

    Attributes:
        finger: index of the pushing finger.
        contact_s: seconds from the window's begin until the tip comes near the cube.
        joint_position_rad: as measured, shape (s, 9); so the two below.
        joint_velocity_rad_s: likewise.
        torque_nm: that the driver sent to the motors.
        tip_m: of the pushing finger, shape (s, 3).
        jacobian_m: of its tip by its joints, shape (s, 3, 3), m/rad.
        cube_xy_m: where the cube was seen before, mean of ``frames_before``, shape (2,).
        cube_yaw_rad: how it was turned, modulo a quarter.
        frame_steps: when it was seen during the window, steps since its begin, shape (f,).
        frame_xy_m: where, shape (f, 2).
        frame_yaw_rad: how it was turned, as near to ``cube_yaw_rad`` as a quarter turn allows, shape (f,); NaN if not flat.
        direction: unit vector of the push, horizontal, shape (2,).
        speed_m_s: highest speed of the tip.
    """

    finger: int
    contact_s: float
    joint_position_rad: np.ndarray
    joint_velocity_rad_s: np.ndarray
    torque_nm: np.ndarray
    tip_m: np.ndarray
    jacobian_m: np.ndarray
    cube_xy_m: np.ndarray
    cube_yaw_rad: float
    frames_before: int
    frame_steps: np.ndarray
    frame_xy_m: np.ndarray
    frame_yaw_rad: np.ndarray
    direction: np.ndarray
    speed_m_s: float


def push_windows(recording: Recording) -> list[PushWindow]:
    """The pushes of a recording on a grid of 1 ms, in order; none without joints, torques and a cube."""
    joints = recording.joints
    if joints is None or joints.commanded_torque_nm is None or joints.velocity_rad_s is None or not recording.objects:
        return []
    if joints.position_rad.shape[1] != 9 or abs(recording.step_s - c.PHYSICS_STEP_S) > 1e-9:
        return []
    tips = fingertip_position_world_m(joints.position_rad).reshape(-1, 3, 3)
    flat, yaw = flat_yaw_rad(recording.objects[0].quat_wxyz)
    windows, settled_s = [], -np.inf
    for first, last in _runs(np.any(tips[:, :, 2] < _LOW_M, axis=1)):
        window = _window(recording, tips, flat, yaw, first, last, settled_s)
        settled_s = last * recording.step_s + _SETTLED_S
        if window is not None:
            windows.append(window)
    return windows


def _runs(marked: np.ndarray) -> list[tuple[int, int]]:
    """First and last-but-one index of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    return list(zip(edges[::2], edges[1::2], strict=True))


def _window(
    recording: Recording, tips: np.ndarray, flat: np.ndarray, yaw: np.ndarray, first: int, last: int, settled_s: float
) -> PushWindow | None:
    cube, joints, step_s = recording.objects[0], recording.joints, recording.step_s
    assert joints is not None and joints.commanded_torque_nm is not None and joints.velocity_rad_s is not None
    finger = int(tips[first:last, :, 2].mean(axis=0).argmin())
    lies = usable_frames(cube) & flat & (np.abs(cube.position_m[:, 2] - c.CUBE_REST_HEIGHT_M) < _HEIGHT_M)
    before = lies & (cube.time_s > settled_s) & (cube.time_s < first * step_s)
    if before.sum() < _LEAST_FRAMES:
        return None
    xy, turned = _resting_pose(cube.position_m[before, :2], yaw[before])
    distance = _distance_to_square_m(tips[first:last, finger, :2] - xy, turned)
    near = np.flatnonzero(distance < c.TIP_RADIUS_M + NEAR_M)
    steps, begin = round(LENGTH_S / step_s), first + (int(near[0]) if len(near) else 0) - round(BEFORE_S / step_s)
    if not len(near) or begin < 0 or begin + steps > len(tips):
        return None
    before = lies & (cube.time_s > settled_s) & (cube.time_s < (begin + round(BEFORE_S / step_s)) * step_s - 0.02)
    xy, turned = _resting_pose(cube.position_m[before, :2], yaw[before])
    rows = slice(begin, begin + steps)
    tip = tips[rows, finger]
    if np.isnan(joints.position_rad[rows]).any() or np.isnan(joints.commanded_torque_nm[rows]).any():
        return None
    way = tip[round(BEFORE_S / step_s) + 60, :2] - tip[round(BEFORE_S / step_s) - 60, :2]
    speed = np.linalg.norm(tip[40:, :2] - tip[:-40, :2], axis=1).max() / (40 * step_s)
    during = usable_frames(cube) & (cube.time_s >= begin * step_s) & (cube.time_s < (begin + steps - 1) * step_s)
    quarter = np.round((yaw[during] - turned) / (np.pi / 2)) * np.pi / 2
    return PushWindow(
        finger=finger,
        contact_s=BEFORE_S,
        joint_position_rad=np.asarray(joints.position_rad[rows], dtype=float),
        joint_velocity_rad_s=np.asarray(joints.velocity_rad_s[rows], dtype=float),
        torque_nm=np.asarray(joints.commanded_torque_nm[rows], dtype=float),
        tip_m=tip,
        jacobian_m=_jacobian_m(joints.position_rad[rows], finger),
        cube_xy_m=xy,
        cube_yaw_rad=turned,
        frames_before=int(before.sum()),
        frame_steps=np.round(cube.time_s[during] / step_s).astype(int) - begin,
        frame_xy_m=cube.position_m[during, :2],
        frame_yaw_rad=np.where(flat[during], yaw[during] - quarter, np.nan),
        direction=way / max(float(np.linalg.norm(way)), 1e-9),
        speed_m_s=float(speed),
    )


def usable_frames(cube: ObjectSignals) -> np.ndarray:
    """Frames with a pose of their own, shape (m,): a filter that is not sure repeats the pose before."""
    new = np.ones(len(cube.time_s), dtype=bool)
    new[1:] = (np.diff(cube.position_m, axis=0) != 0.0).any(axis=1)
    return new


def flat_yaw_rad(quat_wxyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether a cube lies on a face, and the angle of its sides about the vertical, within a quarter turn.

    All 24 ways in which a cube fits itself give the same angle, so that a tracker that takes faces for each other does no harm.

    Args:
        quat_wxyz: shape (m, 4).

    Returns:
        Shapes (m,) and (m,), rad from 0 to pi / 2.
    """
    matrix = rotation_matrices(quat_wxyz)
    upright = np.abs(matrix[:, 2, :])
    up = upright.argmax(axis=1)
    rows = np.arange(len(matrix))
    side = matrix[rows, :, (up + 1) % 3]
    return upright[rows, up] > _FLAT, np.arctan2(side[:, 1], side[:, 0]) % (np.pi / 2)


def rotation_matrices(quat_wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices of orientations (m, 4), shape (m, 3, 3)."""
    w, x, y, z = np.asarray(quat_wxyz, dtype=float).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=1,
    )


def _resting_pose(xy_m: np.ndarray, yaw_rad: np.ndarray) -> tuple[np.ndarray, float]:
    """Mean place (2,) and angle of frames (k, 2), (k,) without those that lie far off."""
    near = np.linalg.norm(xy_m - np.median(xy_m, axis=0), axis=1) < _OUTLIER_M
    angle = float(np.angle(np.exp(4j * yaw_rad[near]).mean())) / 4
    return xy_m[near].mean(axis=0), angle


def _distance_to_square_m(offset_m: np.ndarray, yaw_rad: float) -> np.ndarray:
    """Distances of points (k, 2), as seen from the cube's centre, from its outline seen from above."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = np.abs(offset_m @ np.array([[cos, -sin], [sin, cos]])).T - c.CUBE_WIDTH_M / 2
    return np.hypot(np.maximum(x, 0.0), np.maximum(y, 0.0)) + np.minimum(np.maximum(x, y), 0.0)


def _jacobian_m(joint_position_rad: np.ndarray, finger: int) -> np.ndarray:
    """Derivatives of a finger's tip by its joints, shape (s, 3 axes, 3 joints)."""
    columns, small = [], 1e-5
    for joint in range(3):
        ahead, behind = (np.array(joint_position_rad, dtype=float) for _ in range(2))
        ahead[:, 3 * finger + joint] += small
        behind[:, 3 * finger + joint] -= small
        change = fingertip_position_world_m(ahead) - fingertip_position_world_m(behind)
        columns.append(change[:, 3 * finger : 3 * finger + 3] / (2 * small))
    return np.stack(columns, axis=-1)


def all_push_windows(recordings: Sequence[Recording]) -> list[PushWindow]:
    """The pushes of all recordings."""
    return [window for recording in recordings for window in push_windows(recording)]
