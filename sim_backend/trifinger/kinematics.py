"""Forward kinematics of the three fingers, vectorised over any number of leading axes."""

import numpy as np

from sim_backend.trifinger import constants as c

_AXES = {(1.0, 0.0, 0.0): (1, 2), (0.0, 1.0, 0.0): (2, 0)}


def fingertip_position_world_m(joint_position_rad: np.ndarray) -> np.ndarray:
    """Positions of the centres of the tip spheres.

    Args:
        joint_position_rad: shape (..., 9), order of ``constants.JOINT_NAMES``, rad.

    Returns:
        Shape (..., 9): x, y, z of finger0, finger120 and finger240 in the world frame, m.
    """
    joints = np.asarray(joint_position_rad, dtype=float)
    joints = joints.reshape(*joints.shape[:-1], 3, 3)
    point = np.broadcast_to(np.array(c.LINKS[3].origin_m), joints.shape).copy()
    for index in (2, 1, 0):
        link = c.LINKS[index]
        assert link.joint_axis is not None
        point = _rotate(point, _AXES[link.joint_axis], joints[..., index]) + np.array(link.origin_m)
    yaw = np.array(c.FINGER_YAW_RAD)
    point = _rotate(point, (0, 1), np.broadcast_to(yaw, point.shape[:-1]))
    point[..., 2] += c.FINGER_BASE_HEIGHT_M
    return point.reshape(*point.shape[:-2], 9)


def _rotate(point: np.ndarray, plane: tuple[int, int], angle_rad: np.ndarray) -> np.ndarray:
    """Rotate points within the plane of two axes, from the first towards the second."""
    first, second = plane
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned = point.copy()
    turned[..., first] = cos * point[..., first] - sin * point[..., second]
    turned[..., second] = sin * point[..., first] + cos * point[..., second]
    return turned
