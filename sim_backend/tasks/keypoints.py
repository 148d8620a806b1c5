"""The eight corners of the cube as keypoints, and rotations of points by quaternions."""

import numpy as np

from sim_backend.trifinger import constants as c

KEYPOINTS_CUBE_M = np.array(
    [[(-1 if i >> axis & 1 else 1) * c.CUBE_WIDTH_M / 2 for axis in range(3)] for i in range(8)], dtype=float
)
"""Corner i in the cube's frame, shape (8, 3), m: bits 0, 1, 2 of i give the signs of x, y, z (a clear bit is plus)."""


def rotation_matrix(quat_wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions; shape (..., 4) to (..., 3, 3)."""
    quat = np.asarray(quat_wxyz)
    w, x, y, z = (quat[..., index] for index in range(4))
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    turned = np.empty((*quat.shape[:-1], 3, 3), np.result_type(quat, np.float32))
    turned[..., 0, 0], turned[..., 0, 1], turned[..., 0, 2] = 1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)
    turned[..., 1, 0], turned[..., 1, 1], turned[..., 1, 2] = 2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)
    turned[..., 2, 0], turned[..., 2, 1], turned[..., 2, 2] = 2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)
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
