"""Rotations as matrices, vectors and quaternions (wxyz), few at a time or many."""

import numpy as np


def matrix_of_quat(quat_wxyz: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a unit quaternion (4,) wxyz."""
    w, x, y, z = quat_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_of_matrix(rotation: np.ndarray) -> np.ndarray:
    """The quaternion (4,) wxyz, w not negative, of a rotation matrix (3, 3), by the largest of its four parts."""
    m = rotation
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    four = np.array([1 + trace, *(1 + 2 * np.diag(m) - trace)])
    largest = int(np.argmax(four))
    off = np.array(
        [
            [four[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], four[1], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], four[2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], four[3]],
        ]
    )
    quat = off[largest] / np.linalg.norm(off[largest])
    return quat if quat[0] >= 0.0 else -quat


def multiplied(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The product of two quaternions (4,) wxyz: the other rotation first, then the one."""
    w, v, x, u = one[0], one[1:], other[0], other[1:]
    return np.array([w * x - v @ u, *(w * u + x * v + np.cross(v, u))])


def matrices_of(rotation_rad: np.ndarray) -> np.ndarray:
    """Matrices (p, 3, 3) of rotation vectors (p, 3), rad."""
    angle = np.linalg.norm(rotation_rad, axis=1)
    x, y, z = (rotation_rad / np.where(angle > 0.0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sin * cross + (1.0 - cos) * cross @ cross


def angle_between_rad(one: np.ndarray, other: np.ndarray) -> float:
    """The angle of the rotation from one matrix (3, 3) to another, rad."""
    turn = one.T @ other
    sine = np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.arctan2(sine / 2, (np.trace(turn) - 1) / 2))
