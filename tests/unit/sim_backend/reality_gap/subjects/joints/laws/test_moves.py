"""How far one step of a fit moves a model."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.moves import within_reach
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

LOSS, TIME = "thermal_derating.loss_per_k", "thermal_derating.time_constant_s"


@pytest.fixture
def state():
    warm = JointState(2)
    return warm.moved(Term(TIME, 1, 1.0), 30.0 - warm.value(TIME)[1])


@pytest.mark.parametrize(("by", "at_last"), [(-58.0, 10.0), (-5.0, 25.0), (20.0, 50.0), (500.0, 90.0)])
def test_a_time_that_decides_a_shape_moves_by_a_factor_of_three_at_most(state, by, at_last):
    terms = (Term(LOSS, 1, 1e-5), Term(TIME, 1, 0.2))
    loss, time_s = within_reach(state, terms, np.array([-0.5, by]))
    assert loss == -0.5, "a size is as far as a straight line says"
    assert 30.0 + time_s == pytest.approx(at_last)


def test_a_place_that_decides_a_shape_has_no_reach(state):
    terms = (Term("cogging.amplitude_nm", 0, 1e-4, (("cogging.phase_rad", 0.0),)), Term("cogging.amplitude_nm", 0, 1e-4))
    np.testing.assert_array_equal(within_reach(state, terms, np.array([5.0, -5.0])), [5.0, -5.0])
