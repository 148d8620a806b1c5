"""The robot's safety pipeline, from the desired to the applied torque, as one pure function of a joint.

The order is the real robot's (robot_fingers, doc/actions_and_observations.rst): soft limits, clip, damping, clip. The same
compiled function runs inside the physics (``native_control.py``) and, vectorised, in tests and tools.
"""

import functools
import math
from collections.abc import Callable

import numba
import numpy as np

from sim_backend.trifinger import constants as c


@numba.njit(inline="always", error_model="numpy")
def joint_applied_torque_nm(
    desired_torque_nm: float,
    position_target_rad: float,
    position_rad: float,
    velocity_rad_s: float,
    soft_lower_rad: float,
    soft_upper_rad: float,
    position_gain_nm_rad: float,
    velocity_gain_nm_s_rad: float,
    damping_nm_s_rad: float,
    max_torque_nm: float,
) -> float:
    """Torque that acts on one joint for one step of 1 ms.

    A joint outside its soft limits obeys only actions that point back; any other is replaced by a position command to the
    limit with the default gains. A target of NaN means that the action has no position part.

    Returns:
        The applied torque, N m.
    """
    torque_nm, target_rad = desired_torque_nm, position_target_rad
    if position_rad > soft_upper_rad:
        points_back = torque_nm < 0.0 if math.isnan(target_rad) else target_rad <= soft_upper_rad
        if not points_back:
            torque_nm, target_rad = 0.0, soft_upper_rad
    elif position_rad < soft_lower_rad:
        points_back = torque_nm > 0.0 if math.isnan(target_rad) else target_rad >= soft_lower_rad
        if not points_back:
            torque_nm, target_rad = 0.0, soft_lower_rad
    if not math.isnan(target_rad):
        torque_nm += position_gain_nm_rad * (target_rad - position_rad) - velocity_gain_nm_s_rad * velocity_rad_s
    torque_nm = min(max(torque_nm, -max_torque_nm), max_torque_nm)
    torque_nm -= damping_nm_s_rad * velocity_rad_s
    return min(max(torque_nm, -max_torque_nm), max_torque_nm)


@functools.cache
def _vectorised() -> Callable[..., np.ndarray]:
    """The pipeline as a numpy function, compiled when first needed."""
    return numba.vectorize(["float64(" + ",".join(["float64"] * 10) + ")"])(joint_applied_torque_nm.py_func)  # pyrefly: ignore[missing-attribute]


def applied_torque_nm(
    desired_torque_nm: np.ndarray,
    position_target_rad: np.ndarray,
    joint_position_rad: np.ndarray,
    joint_velocity_rad_s: np.ndarray,
    *,
    position_gain_factor: float | np.ndarray = 1.0,
    damping_factor: float | np.ndarray = 1.0,
) -> np.ndarray:
    """The safety pipeline for all joints of any number of robots.

    Args:
        desired_torque_nm: shape (..., 9), N m.
        position_target_rad: shape (..., 9), rad, NaN where the action has no position part.
        joint_position_rad: shape (..., 9), rad.
        joint_velocity_rad_s: shape (..., 9), rad/s.
        position_gain_factor: of the stiffness, for each joint or all.
        damping_factor: of the safety damping, for each joint or all.

    Returns:
        Applied torque, shape (..., 9), N m.
    """
    return _vectorised()(
        desired_torque_nm,
        position_target_rad,
        joint_position_rad,
        joint_velocity_rad_s,
        c.SOFT_LIMIT_LOWER_RAD,
        c.SOFT_LIMIT_UPPER_RAD,
        c.POSITION_GAIN_NM_RAD * position_gain_factor,
        c.VELOCITY_GAIN_NM_S_RAD,
        c.SAFETY_DAMPING_NM_S_RAD * damping_factor,
        c.MAX_TORQUE_NM,
    )
