"""Goals that users bring, in place of what a trial's seed draws."""

from dataclasses import replace

import numpy as np

from api_schemas.goal import OwnGoal
from sim_backend.driver.driver import Start
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c


def with_own(start: Start, goal: Goal, own: OwnGoal | None) -> tuple[Start, Goal]:
    """Start and goal of a trial (n = 1), of one's own as far as they are given."""
    if own is None:
        return start, goal
    position_m, quat_wxyz = np.array([own.position_m]), np.array([own.quat_wxyz])
    goal = replace(goal, cube_position_world_m=position_m, cube_quat_wxyz=quat_wxyz)
    if own.start is None:
        return start, goal
    half_yaw = own.start.yaw_rad / 2
    placed = np.array([[*own.start.position_m, c.CUBE_REST_HEIGHT_M]])
    turned = np.array([[np.cos(half_yaw), 0.0, 0.0, np.sin(half_yaw)]])
    return replace(start, cube_position_world_m=placed, cube_quat_wxyz=turned), goal
