"""Turns about the vertical: how much of one a goal asks for, and which part of it a hand may try with one grasp."""

import numpy as np

LARGEST_RAD = np.radians(150)
STEP_RAD = np.radians(20)
"""Between turns that are tried where a grasp does not reach the whole one."""


def yaw_between_rad(from_quat_wxyz: np.ndarray, to_quat_wxyz: np.ndarray) -> float:
    """The turn about the vertical that brings one orientation nearest to another, -pi to pi rad; shapes (4,).

    It is the twist of ``to * inverse(from)``; what is left of that rotation afterwards has a horizontal axis.
    """
    (w, x, y, z), (tw, tx, ty, tz) = from_quat_wxyz, to_quat_wxyz
    cosine, sine = tw * w + tx * x + ty * y + tz * z, tz * w - tw * z + ty * x - tx * y
    return wrapped(2 * np.arctan2(sine, cosine))


def wrapped(angle_rad: float) -> float:
    """The same angle between -pi and pi."""
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def about_vertical(angle_rad: float) -> np.ndarray:
    """The matrix of a turn, shape (3, 3)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def parts_of(turn_rad: float) -> list[float]:
    """Turns that leave less than there is to turn, either way round, the one that leaves least first."""
    steps = np.arange(1, LARGEST_RAD / STEP_RAD + 1e-9) * STEP_RAD
    left = {float(part): abs(wrapped(turn_rad - part)) for part in (*steps, *-steps)}
    return sorted((part for part in left if left[part] < abs(turn_rad)), key=left.__getitem__)
