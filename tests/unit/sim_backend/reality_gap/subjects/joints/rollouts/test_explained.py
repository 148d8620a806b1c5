"""How much of an error causes have to take to be its causes."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.rollouts.explained import explained_at, explained_beside
from sim_backend.reality_gap.subjects.joints.rollouts.limits import HealthyLimits
from tests.unit.sim_backend.reality_gap.subjects.joints.ends_of_windows import fit_of


@pytest.mark.parametrize(
    ("left_rad", "far_rad", "gains"),
    [(0.0018, None, False), (0.0014, None, True), (0.0018, 0.003, True), (0.0021, 0.003, False)],
    ids=["too little for a healthy robot", "three fifths", "half of what is too far", "less than half"],
)
def test_of_a_robot_that_may_be_healthy_a_cause_has_to_take_more(left_rad, far_rad, gains):
    nominal, fit = fit_of(np.tile([0.001, 0.004], (8, 1))), fit_of(np.tile([0.001, left_rad], (8, 1)))
    is_gain = explained_at(nominal, fit, None if far_rad is None else np.full(2, far_rad))
    assert is_gain.tolist() == [False, gains]


@pytest.mark.parametrize(
    ("far_rad", "left_rad", "is_gain"),
    [(0.012, 0.005, False), (0.012, 0.003, True), (0.016, 0.007, True), (0.003, 0.001, False)],
    ids=["half of an event", "all of it", "half of what is too far", "none"],
)
def test_half_of_what_is_off_in_few_windows_is_enough_only_where_the_rest_is_as_healthy_robots_are(far_rad, left_rad, is_gain):
    limits = HealthyLimits(*(np.full(2, value) for value in (0.005, 0.015, 0.004, 1.0, 0.001)))
    nominal, fit = (fit_of(np.repeat([[0.001, 0.001], [0.001, far]], [16, 4], axis=0)) for far in (far_rad, left_rad))
    assert explained_beside(nominal, fit, limits, limits).tolist() == [False, is_gain]
