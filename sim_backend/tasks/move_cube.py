"""The cube tasks: ``push`` and ``lift`` of Gürtler et al. (ICLR 2023), ``floor_pose``, the four levels of the 2020 challenge.

Goals are drawn as in trifinger_simulation ``tasks/move_cube``: push is level 1 and lift is level 4 with the durations,
tolerances and rewards of the published data sets. Floor pose lies between them: push with a yaw that counts.
"""

import numpy as np

from sim_backend.tasks.task import Goal, Task, draw_in_disc, draw_quat_wxyz, draw_yaw_quat_wxyz
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m

IDENTITY_QUAT_WXYZ = np.array([1.0, 0.0, 0.0, 0.0])
LEVEL_2_HEIGHT_M = c.CUBE_REST_HEIGHT_M + 0.05


def _goal(position: np.ndarray, quat_wxyz: np.ndarray = IDENTITY_QUAT_WXYZ) -> Goal:
    return Goal(position[None], quat_wxyz[None].copy(), fingertip_position_world_m(c.START_JOINT_POSITION_RAD)[None])


def _on_the_floor(rng: np.random.Generator) -> Goal:
    return _goal(np.array([*draw_in_disc(rng, c.MAX_CUBE_CENTRE_DISTANCE_M), c.CUBE_REST_HEIGHT_M]))


def _turned_on_the_floor(rng: np.random.Generator) -> Goal:
    xy = draw_in_disc(rng, c.MAX_CUBE_CENTRE_DISTANCE_M)
    return _goal(np.array([*xy, c.CUBE_REST_HEIGHT_M]), draw_yaw_quat_wxyz(rng))


def _above_the_centre(rng: np.random.Generator) -> Goal:  # noqa: ARG001 - every goal of this level is the same
    return _goal(np.array([0.0, 0.0, LEVEL_2_HEIGHT_M]))


def _in_the_air(rng: np.random.Generator) -> Goal:
    xy = draw_in_disc(rng, c.MAX_CUBE_CENTRE_DISTANCE_M)
    return _goal(np.array([*xy, rng.uniform(c.CUBE_REST_HEIGHT_M, c.MAX_GOAL_HEIGHT_M)]))


def _any_pose(rng: np.random.Generator) -> Goal:
    xy = draw_in_disc(rng, c.MAX_CUBE_CENTRE_DISTANCE_M)
    return _goal(np.array([*xy, rng.uniform(c.CUBE_RADIUS_M, c.MAX_GOAL_HEIGHT_M)]), draw_quat_wxyz(rng))


PUSH = Task("push", 15.0, _on_the_floor, "move the cube to a place on the floor")
LIFT = Task("lift", 30.0, _any_pose, "bring the cube to any pose in the air", orientation_counts=True)
FLOOR_POSE = Task(
    "floor_pose",
    15.0,
    _turned_on_the_floor,
    "move the cube to a place on the floor and turn it about the vertical",
    orientation_counts=True,
    starts_upright=True,
)
MOVE_CUBE_LEVELS = (
    Task("move_cube_1", 15.0, _on_the_floor, "2020 challenge, level 1: a place on the floor", challenge_cost=True),
    Task("move_cube_2", 15.0, _above_the_centre, "2020 challenge, level 2: 5 cm above the centre", challenge_cost=True),
    Task("move_cube_3", 15.0, _in_the_air, "2020 challenge, level 3: a place in the air", challenge_cost=True),
    Task("move_cube_4", 15.0, _any_pose, "2020 challenge, level 4: any pose", orientation_counts=True, challenge_cost=True),
)
