"""Joint positions for a tip."""

import numpy as np
import pytest

from robot_farm.arena.finger_reach import reach
from sim_backend.trifinger.kinematics import fingertip_position_world_m


@pytest.mark.parametrize("finger", [0, 1, 2])
def test_the_tip_is_where_it_was_wanted(finger):
    azimuth = np.deg2rad(70 - 120 * finger)
    wanted = np.array([0.15 * np.cos(azimuth), 0.15 * np.sin(azimuth), 0.05])
    joints, moved_m = reach(finger, wanted)
    assert joints is not None
    assert moved_m == 0.0
    tip = fingertip_position_world_m(np.tile(joints, 3))[3 * finger : 3 * finger + 3]
    np.testing.assert_allclose(tip, wanted, atol=1e-12)


def test_a_place_too_far_away_is_not_reached():
    assert reach(0, np.array([0.6, 0.0, 0.05])) == (None, float("inf"))


def test_somebody_reaches_behind_an_object_anywhere_at_the_wall():
    for azimuth in np.arange(0.0, 2 * np.pi, np.pi / 36):
        moved_m = [reach(f, np.array([0.2 * np.cos(azimuth), 0.2 * np.sin(azimuth), 0.06]))[1] for f in range(3)]
        assert min(moved_m) <= 0.02
