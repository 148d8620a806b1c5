"""Errors of tracked poses, as compiled functions over n robots; parameters that are absent leave a pose untouched."""

import math

import numba
import numpy as np


@numba.njit
def scaled_position_m(position_m: np.ndarray, factor_error: np.ndarray) -> np.ndarray:
    """Positions (n, 3) seen too far from the world's origin, or too near; ``factor_error`` (n,)."""
    out = position_m.copy()
    for i in range(len(position_m)):
        for axis in range(3):
            out[i, axis] *= 1.0 + factor_error[i]
    return out


@numba.njit
def quat_product(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """``out`` = ``a`` b, each of shape (4,), wxyz; ``out`` may not be one of them."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


@numba.njit
def turned_quat(quat_wxyz: np.ndarray, rotation_rad: np.ndarray) -> np.ndarray:
    """Orientations (n, 4) wxyz turned by rotation vectors (n, 3) in the world frame, rad."""
    out, turn = quat_wxyz.copy(), np.empty(4)
    for i in range(len(quat_wxyz)):
        x, y, z = rotation_rad[i]
        angle = math.sqrt(x * x + y * y + z * z)
        if angle > 0.0:
            share = math.sin(angle / 2.0) / angle
            turn[0], turn[1], turn[2], turn[3] = math.cos(angle / 2.0), share * x, share * y, share * z
            quat_product(turn, quat_wxyz[i], out[i])
    return out


@numba.njit
def offset_position_m(position_m: np.ndarray, offset_m: np.ndarray, rotation_rad: np.ndarray) -> np.ndarray:
    """Positions (n, 3) as cameras see them that stand askew: turned about the world's origin, then moved; all (n, 3)."""
    out = position_m.copy()
    for i in range(len(position_m)):
        x, y, z = rotation_rad[i]
        angle = math.sqrt(x * x + y * y + z * z)
        if angle > 0.0:
            x, y, z = x / angle, y / angle, z / angle
            px, py, pz = position_m[i]
            cos, sin = math.cos(angle), math.sin(angle)
            along = (x * px + y * py + z * pz) * (1.0 - cos)
            out[i, 0] = px * cos + (y * pz - z * py) * sin + x * along
            out[i, 1] = py * cos + (z * px - x * pz) * sin + y * along
            out[i, 2] = pz * cos + (x * py - y * px) * sin + z * along
        for axis in range(3):
            if offset_m[i, axis] != 0.0:
                out[i, axis] += offset_m[i, axis]
    return out


@numba.njit
def offset_pose(
    position_m: np.ndarray, quat_wxyz: np.ndarray, offset_m: np.ndarray, rotation_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, 3) and orientation (n, 4) as cameras see them that stand askew (:func:`offset_position_m`)."""
    return offset_position_m(position_m, offset_m, rotation_rad), turned_quat(quat_wxyz, rotation_rad)


@numba.njit
def noisy_pose(
    position_m: np.ndarray, quat_wxyz: np.ndarray, position_std_m: np.ndarray, rotation_std_rad: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Poses with an error.

    Args:
        position_m: shape (n, 3).
        quat_wxyz: shape (n, 4).
        position_std_m: standard deviation of each coordinate, shape (n,).
        rotation_std_rad: standard deviation of each component of the rotation vector, shape (n,).
        normal: standard normal numbers, shape (n, 6): position, then rotation.

    Returns:
        Position (n, 3) and orientation (n, 4).
    """
    moved, turn = position_m.copy(), np.zeros(position_m.shape)
    for i in range(len(position_m)):
        for axis in range(3):
            if position_std_m[i] > 0.0:
                moved[i, axis] += position_std_m[i] * normal[i, axis]
            turn[i, axis] = rotation_std_rad[i] * normal[i, 3 + axis]
    return moved, turned_quat(quat_wxyz, turn)


def _cube_turns_wxyz() -> np.ndarray:
    """The 24 rotations that bring a cube onto itself, shape (24, 4); the first one does nothing."""
    one, half, root = 1.0, 0.5, math.sqrt(0.5)
    axes, signs = np.eye(3), (1.0, -1.0)
    turns = [[one, 0.0, 0.0, 0.0], *([0.0, *axis] for axis in axes)]
    turns += [[root, *(sign * root * axis)] for axis in axes for sign in signs]
    turns += [[0.0, *(root * (axes[a] + sign * axes[b]))] for a, b in ((0, 1), (0, 2), (1, 2)) for sign in signs]
    turns += [[half, half * x, half * y, half * z] for x in signs for y in signs for z in signs]
    return np.array(turns)


CUBE_TURNS_WXYZ = _cube_turns_wxyz()


@numba.njit
def jump_probability(probability: np.ndarray, growth: np.ndarray, hidden_faces: np.ndarray) -> np.ndarray:
    """Probability of a wrong assignment of colours to faces, shape (n,).

    It grows by the factor ``growth`` for each face that no camera sees though it looks at one (``hidden_faces``, (n,), in
    parts of faces).
    """
    out = np.empty(len(probability))
    for i in range(len(probability)):
        out[i] = min(probability[i] * growth[i] ** hidden_faces[i], 1.0)
    return out


@numba.njit
def jumped_quat(quat_wxyz: np.ndarray, probability: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Orientations (n, 4) of which some are wrong by one of the 23 other ways in which a cube fits itself.

    Args:
        quat_wxyz: shape (n, 4).
        probability: shape (n,).
        uniform: numbers in (0, 1), shape (n, 2): whether, and which.
    """
    out = quat_wxyz.copy()
    for i in range(len(quat_wxyz)):
        if uniform[i, 0] < probability[i]:
            quat_product(quat_wxyz[i], CUBE_TURNS_WXYZ[1 + int(23.0 * uniform[i, 1])], out[i])
    return out
