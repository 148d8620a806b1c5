"""What an observation says about a turn, and what several say about a cube that lies still."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.grasping.sight import REPORTS, Reports, Sight
from sim_backend.trifinger import constants as c


def yaw_quat(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad / 2), 0.0, 0.0, np.sin(angle_rad / 2)])


def sight(cube_rad: float, goal_rad: float) -> Sight:
    cube_m = np.array([0.02, 0.03, c.CUBE_REST_HEIGHT_M])
    return Sight(c.START_JOINT_POSITION_RAD, cube_m, yaw_quat(cube_rad), 0.09, np.zeros(3), yaw_quat(goal_rad))


def test_another_goal_differs_by_a_turn_however_the_cube_is_turned_meanwhile():
    before, after = sight(0.2, 0.5), sight(0.9, 1.3)
    assert before.turn_to_goal_of(after) == pytest.approx(0.8)
    assert not before.has_goal_of(after)
    assert before.has_goal_of(sight(0.9, 0.5))


def test_a_goal_without_orientation_has_only_a_place():
    before = replace(sight(0.2, 0.5), goal_quat_wxyz=None)
    assert (before.turn_rad, before.turn_to_goal_of(before)) == (0.0, 0.0)
    assert before.has_goal_of(before)


@pytest.mark.parametrize("goal_rad", [1.0, np.pi])
def test_turns_of_noisy_reports_are_put_together_across_half_a_turn(goal_rad):
    reports = Reports()
    for noise in (-0.02, 0.02, 0.0)[:REPORTS]:
        found = reports.at_rest(sight(noise, goal_rad))
    assert found is not None
    assert abs(found.turn_rad) == pytest.approx(goal_rad, abs=1e-9)
