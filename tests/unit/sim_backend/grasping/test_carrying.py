"""A cube that is carried is turned in the air, and corrected where reports say that it does not follow."""

import numpy as np
import pytest

from sim_backend.grasping.carrying import LARGEST_CORRECTION_RAD, SLIPPED_REPORTS, TURNING_RAD_S, Carried
from sim_backend.trifinger import constants as c

START = np.array([0.0, 0.05, c.CUBE_REST_HEIGHT_M])
GOAL = np.array([0.0, -0.05, c.CUBE_REST_HEIGHT_M])
PERIOD_S = 0.02


@pytest.mark.parametrize("turn_rad", [-2.0, 0.3])
@pytest.mark.parametrize("goal_m", [GOAL, START])
def test_it_is_turned_in_the_air_and_not_too_fast(turn_rad, goal_m):
    carried = Carried(START, goal_m, PERIOD_S, turn_rad)
    way = [(carried.go_on()[2], carried.turned_rad) for _ in range(200)]
    height, turned = np.array(way).T
    assert carried.arrived
    assert turned[-1] == pytest.approx(turn_rad)
    turns = np.flatnonzero(np.abs(np.diff(turned)) > 0)
    assert height[turns].min() > c.CUBE_REST_HEIGHT_M + 0.02
    assert np.abs(np.diff(turned)).max() <= TURNING_RAD_S * PERIOD_S + 1e-9


def reported(carried: Carried, reports: int, turned_rad: float) -> None:
    for _ in range(reports):
        place_m = carried.go_on()
        assert not carried.lost(place_m, 0.0, turned_rad)


def test_what_is_missing_of_a_turn_at_the_goal_is_added():
    carried = Carried(START, GOAL, PERIOD_S, 0.5)
    reported(carried, 200, 0.4)
    assert carried.turned_rad == pytest.approx(0.5 + LARGEST_CORRECTION_RAD)
    assert not carried.slipped, "0.1 rad are little"


def test_a_cube_that_does_not_follow_has_slipped_and_with_another_goal_it_has_another_chance():
    carried = Carried(START, GOAL, PERIOD_S, 1.0)
    while not carried.arrived:
        carried.go_on()
    reported(carried, SLIPPED_REPORTS - 1, 0.5)
    assert not carried.slipped
    reported(carried, 1, 0.5)
    assert carried.slipped
    carried.aim(START, 0.0)
    assert not carried.slipped
