"""How well a goal was reached: errors, success, reward and the measures of a whole trial."""

from dataclasses import dataclass

import numpy as np

from api_schemas.tolerance import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M
from sim_backend.tasks.keypoints import angle_between_rad, cube_keypoints_world_m
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m


@dataclass(frozen=True)
class Scores:
    """Per control step, all of one shape: errors in m and rad, whether the goal is reached, and the reward."""

    position_error_m: np.ndarray
    angle_error_rad: np.ndarray
    success: np.ndarray
    reward: np.ndarray


def kernel(distance_m: np.ndarray) -> np.ndarray:
    """Keypoint kernel 1 / (e^(ad) + 2 + e^(-ad)), at most 1/4, with a = 30 per metre (Gürtler et al.; Allshire et al.)."""
    scaled = c.KEYPOINT_KERNEL_PER_M * np.asarray(distance_m)
    return 1.0 / (np.exp(scaled) + 2.0 + np.exp(-scaled))


def score(
    task: Task,
    goal: Goal,
    cube_position_world_m: np.ndarray,
    cube_quat_wxyz: np.ndarray,
    joint_position_rad: np.ndarray,
) -> Scores:
    """Scores of true states against the goal.

    Args:
        task: the task.
        goal: the goal; its leading axis must broadcast against that of the states.
        cube_position_world_m: shape (..., 3), m.
        cube_quat_wxyz: shape (..., 4).
        joint_position_rad: shape (..., 9), rad.

    Returns:
        Scores of shape (...).
    """
    if not task.moves_cube:
        tips = fingertip_position_world_m(joint_position_rad) - goal.fingertip_position_world_m
        distance = np.linalg.norm(tips.reshape(*tips.shape[:-1], 3, 3), axis=-1)
        error = distance.max(axis=-1)
        return Scores(error, np.zeros_like(error), error < POSITION_TOLERANCE_M, 4 * kernel(distance).mean(axis=-1))
    offset = cube_position_world_m - goal.cube_position_world_m
    position_error = np.linalg.norm(offset, axis=-1)
    angle_error = angle_between_rad(cube_quat_wxyz, goal.cube_quat_wxyz)
    success = position_error < POSITION_TOLERANCE_M
    if task.orientation_counts:
        success &= angle_error < ANGLE_TOLERANCE_RAD
    if task.challenge_cost:
        reward = -_challenge_cost(offset, angle_error if task.orientation_counts else None)
    elif task.orientation_counts:
        corners = cube_keypoints_world_m(cube_position_world_m, cube_quat_wxyz) - cube_keypoints_world_m(
            goal.cube_position_world_m, goal.cube_quat_wxyz
        )
        reward = 4 * kernel(np.linalg.norm(corners.reshape(*corners.shape[:-1], 8, 3), axis=-1)).mean(axis=-1)
    else:
        reward = 4 * kernel(position_error)
    return Scores(position_error, angle_error, success, reward)


def _challenge_cost(offset_m: np.ndarray, angle_error_rad: np.ndarray | None) -> np.ndarray:
    """Cost of the 2020 challenge (trifinger_simulation tasks/move_cube): 0 at the goal, about 1 far away."""
    horizontal = np.linalg.norm(offset_m[..., :2], axis=-1) / c.CHALLENGE_XY_RANGE_M
    cost = (horizontal + np.abs(offset_m[..., 2]) / c.CHALLENGE_Z_RANGE_M) / 2
    return cost if angle_error_rad is None else (cost + angle_error_rad / np.pi) / 2
