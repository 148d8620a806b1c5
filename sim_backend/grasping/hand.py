"""How small motions of the joints move the fingertips, and what holds the fingers up against gravity."""

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m, link_point_world_m

_STEP_RAD = 1e-5
_BODIES = [(index, link.mass_kg, link.centre_of_mass_m) for index, link in enumerate(c.LINKS)]


def tip_jacobian(joint_position_rad: np.ndarray) -> np.ndarray:
    """Derivatives of the tips' places by their finger's joints.

    Args:
        joint_position_rad: shape (..., 9).

    Returns:
        Shape (..., 3 fingers, 3 coordinates, 3 joints), m/rad.
    """
    forward, back = (fingertip_position_world_m(joints) for joints in _nudged(joint_position_rad))
    by_joint = (forward - back) / (2 * _STEP_RAD)  # (joint, ..., 9)
    return np.moveaxis(by_joint.reshape(*by_joint.shape[:-1], 3, 3), 0, -1)


def gravity_torque_nm(joint_position_rad: np.ndarray) -> np.ndarray:
    """Torques that hold the fingers still in the air, N m; shapes (..., 9)."""
    forward, back = (_potential_j(joints) for joints in _nudged(joint_position_rad))
    by_joint = (forward - back) / (2 * _STEP_RAD)  # (joint, ..., finger)
    return np.moveaxis(by_joint, 0, -1).reshape(*by_joint.shape[1:-1], 9)


def _nudged(joint_position_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first, second or third joint of every finger a little further, and a little back; shapes (3, ..., 9)."""
    joints = np.asarray(joint_position_rad, dtype=float)
    nudge = np.tile(np.eye(3) * _STEP_RAD, (1, 3)).reshape(3, *(1,) * (joints.ndim - 1), 9)
    return joints + nudge, joints - nudge


def _potential_j(joint_position_rad: np.ndarray) -> np.ndarray:
    """Potential energy of each finger, shape (..., 3), J, from shape (..., 9)."""
    heights = [mass * link_point_world_m(joint_position_rad, index, place)[..., 2::3] for index, mass, place in _BODIES]
    return c.GRAVITY_M_S2 * np.sum(heights, axis=0)
