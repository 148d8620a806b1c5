"""Reach: bring the three fingertips to places above the floor; a first step that needs no cube."""

import numpy as np

from sim_backend.tasks.move_cube import IDENTITY_QUAT_WXYZ
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m

REACH_LOWER_RAD = np.tile([-0.3, 0.3, -2.4], 3)
REACH_UPPER_RAD = np.tile([0.6, 1.3, -1.2], 3)
MIN_TIP_HEIGHT_M = c.CUBE_WIDTH_M + 2 * c.TIP_RADIUS_M
"""Goals lie above the cube, so that it is never in the way."""


def _fingertips_somewhere(rng: np.random.Generator) -> Goal:
    """Goals come from joint angles within the soft limits, so that each can be reached."""
    while True:
        tips = fingertip_position_world_m(rng.uniform(REACH_LOWER_RAD, REACH_UPPER_RAD))
        if tips[2::3].min() >= MIN_TIP_HEIGHT_M:
            position = np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M])
            return Goal(position[None], IDENTITY_QUAT_WXYZ[None].copy(), tips[None])


REACH = Task("reach", 5.0, _fingertips_somewhere, "bring the three fingertips to places above the cube", moves_cube=False)
