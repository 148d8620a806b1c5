"""What a step is worth in training: how near the goal is, whether the fingers approach, how fast they move.

The terms are those of Allshire et al. (2021) as released (IsaacGymEnvs ``tasks/trifinger.py``, leibnizgym ``rlg_hydra.py``); the
score of a trial is another thing (``scoring.py``).
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim_backend.tasks.keypoints import angle_between_rad, cube_keypoints_world_m
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c


class RewardKind(StrEnum):
    """How nearness to the goal is measured."""

    KEYPOINT_KERNEL = "keypoint kernel"  # of the cube's corners, or of its centre where orientation does not count
    POSITION_ROTATION = "position+rotation"  # a kernel of the distance, and of the angle where orientation counts


@dataclass(frozen=True)
class Reward:
    """Weights of the terms; ``scale`` multiplies their sum.

    ``goal`` counts for each second at the goal. ``approach`` counts for each metre by which the sum of the fingertips'
    distances to the cube shrinks (to their goals, where no cube is moved). ``joint_speed`` counts for the sum of squared joint
    velocities (rad/s)^2 in each step.
    """

    kind: RewardKind = RewardKind.KEYPOINT_KERNEL
    goal: float = 2000.0
    approach: float = 250.0
    joint_speed: float = -0.001
    scale: float = 0.01
    kernel_per_m: float = c.KEYPOINT_KERNEL_PER_M  # of the keypoint kernel: the larger, the more the last centimetre counts
    fine_kernel_per_m: float | None = None  # of a second kernel of the distance, of either kind; the mean of both counts


@dataclass(frozen=True)
class State:
    """What rewards are made of, true and for n robots: (n, 3) m, (n, 4) wxyz, (n, 9) m and (n, 9) rad/s."""

    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    fingertip_position_world_m: np.ndarray
    joint_velocity_rad_s: np.ndarray


POSITION_KERNEL_PER_M = 50.0
"""Of ``POSITION_ROTATION`` (IGE object_dist; leibnizgym object_dist)."""
ANGLE_WEIGHT, ANGLE_SOFTENING = 3.0, 3.0
"""1 / (3 angle + 3), as leibnizgym's object_rot."""


def reward_of(
    reward: Reward, task: Task, goal: Goal, state: State, approached_m: np.ndarray, control_period_s: float
) -> np.ndarray:
    """Reward of one control period, shape (n,).

    Args:
        reward: the weights.
        task: what is asked.
        goal: of the n robots.
        state: at the end of the period.
        approached_m: by how much :func:`fingers_away_m` has shrunk in it, shape (n,).
        control_period_s: its length.
    """
    speed = np.einsum("ij,ij->i", state.joint_velocity_rad_s, state.joint_velocity_rad_s)
    near = nearness(reward, task, goal, state)
    return reward.scale * (reward.goal * control_period_s * near + reward.approach * approached_m + reward.joint_speed * speed)


def fingers_away_m(task: Task, goal: Goal, state: State) -> np.ndarray:
    """Sum of the fingertips' distances to the cube's centre, or to their goals where no cube is moved; shape (n,), m."""
    tips = state.fingertip_position_world_m.reshape(-1, 3, 3)
    to = state.cube_position_world_m[:, None] if task.moves_cube else goal.fingertip_position_world_m.reshape(-1, 3, 3)
    return _length(tips - to).sum(axis=1)


def nearness(reward: Reward, task: Task, goal: Goal, state: State) -> np.ndarray:
    """From 0 far away to 1/4 at the goal (1/4 + 1/3 for position and rotation), shape (n,)."""
    kind = reward.kind
    if not task.moves_cube:
        tips = (state.fingertip_position_world_m - goal.fingertip_position_world_m).reshape(-1, 3, 3)
        return _kernels(reward, reward.kernel_per_m, _length(tips)).mean(axis=1)
    if kind is RewardKind.KEYPOINT_KERNEL and task.orientation_counts:
        corners = cube_keypoints_world_m(state.cube_position_world_m, state.cube_quat_wxyz)
        wanted = cube_keypoints_world_m(goal.cube_position_world_m, goal.cube_quat_wxyz)
        return _kernels(reward, reward.kernel_per_m, _length((corners - wanted).reshape(-1, 8, 3))).mean(axis=1)
    distance = _length(state.cube_position_world_m - goal.cube_position_world_m)
    if kind is RewardKind.KEYPOINT_KERNEL:
        return _kernels(reward, reward.kernel_per_m, distance)
    near = _kernels(reward, POSITION_KERNEL_PER_M, distance)
    if task.orientation_counts:
        near += 1.0 / (ANGLE_WEIGHT * angle_between_rad(state.cube_quat_wxyz, goal.cube_quat_wxyz) + ANGLE_SOFTENING)
    return near


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def _kernels(reward: Reward, per_m: float, distance_m: np.ndarray) -> np.ndarray:
    coarse = _kernel(distance_m, per_m)
    return coarse if reward.fine_kernel_per_m is None else (coarse + _kernel(distance_m, reward.fine_kernel_per_m)) / 2


def _kernel(distance_m: np.ndarray, per_m: float) -> np.ndarray:
    """1 / (e^x + 2 + e^-x) of the scaled distance, as 1 / (4 cosh^2(x / 2))."""
    return 0.25 / np.cosh(0.5 * per_m * distance_m) ** 2
