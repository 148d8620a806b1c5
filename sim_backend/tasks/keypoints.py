"""The eight corners of the cube as keypoints, and rotations of points by quaternions."""

import numpy as np

from sim_backend.trifinger import constants as c

KEYPOINTS_CUBE_M = np.array(
    [[(-1 if i >> axis & 1 else 1) * c.CUBE_WIDTH_M / 2 for axis in range(3)] for i in range(8)], dtype=float
)
"""Corner i in the cube's frame, shape (8, 3), m: bits 0, 1, 2 of i give the signs of x, y, z (a clear bit is plus)."""


_AXES, _NEXT, _LAST = np.array([0, 1, 2]), np.array([1, 2, 0]), np.array([2, 0, 1])
"""x, y, z, and of each the axis after it and the one before it, in turn."""


def rotation_matrix(quat_wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions; shape (..., 4) to (..., 3, 3)."""
    quat = np.asarray(quat_wxyz)
    w, xyz = quat[..., :1], quat[..., 1:]
    yzx, zxy = xyz[..., _NEXT], xyz[..., _LAST]
    across, along = xyz * yzx, w * zxy
    turned = np.empty((*quat.shape[:-1], 3, 3), np.result_type(quat, np.float32))
    turned[..., _AXES, _AXES] = 1 - 2 * (yzx * yzx + zxy * zxy)
    turned[..., _AXES, _NEXT], turned[..., _NEXT, _AXES] = 2 * (across - along), 2 * (across + along)
    return turned


def cube_keypoints_world_m(cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> np.ndarray:
    """Corners of the cube in the world.

    Args:
        cube_position_world_m: shape (..., 3), m.
        cube_quat_wxyz: shape (..., 4).

    Returns:
        Shape (..., 24): x, y, z of corners 0 to 7, m.
    """
    corners = (
        KEYPOINTS_CUBE_M @ np.swapaxes(rotation_matrix(cube_quat_wxyz), -1, -2) + np.asarray(cube_position_world_m)[..., None, :]
    )
    return corners.reshape(*corners.shape[:-2], 24)


def angle_between_rad(first_quat_wxyz: np.ndarray, second_quat_wxyz: np.ndarray) -> np.ndarray:
    """Angle of the rotation between orientations; shapes (..., 4) to (...), 0 to pi rad."""
    cosine = np.abs(np.sum(np.asarray(first_quat_wxyz) * np.asarray(second_quat_wxyz), axis=-1))
    return 2 * np.arccos(np.minimum(cosine, 1.0))
