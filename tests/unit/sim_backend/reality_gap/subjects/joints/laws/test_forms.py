"""Another form of a law begins where it does about the same."""

import numpy as np
import pytest

from sim_backend.effects.friction import stribeck_bound_nm
from sim_backend.reality_gap.subjects.joints.laws.forms import in_other_forms
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

SIZE, SPEED, EXPONENT = (f"stribeck_friction.{name}" for name in ("extra_nm", "speed_rad_s", "exponent"))


def bounds_nm(state: JointState) -> np.ndarray:
    """Of the second joint at speeds up to far beyond the law's, N m."""
    size, speed, exponent = (state.value(key)[1] for key in (SIZE, SPEED, EXPONENT))
    return np.array([stribeck_bound_nm(size, speed, exponent, at) for at in np.linspace(0.0, 6.0, 6001)])


def test_the_other_form_has_the_same_area_in_the_same_place_and_leads_back():
    begun = JointState(2).with_values({(SIZE, 1): 0.2, (SPEED, 1): 0.4})
    plain, other = in_other_forms(begun, Term(SIZE, 1, 1e-3))
    assert [plain.value(key)[1] for key in (SIZE, SPEED, EXPONENT)] == [0.2, 0.4, 1.0]
    assert other.value(EXPONENT).tolist() == [2.0, 1.0]
    assert other.value(SIZE)[0] == 0.0
    speeds = np.linspace(0.0, 6.0, 6001)
    for moment in (speeds**0, speeds):
        assert moment @ bounds_nm(other) == pytest.approx(moment @ bounds_nm(begun), rel=2e-3)
    _, back = in_other_forms(other, Term(SIZE, 1, 1e-3))
    for key in (SIZE, SPEED, EXPONENT):
        assert back.value(key) == pytest.approx(begun.value(key))


def test_a_law_of_one_form_has_no_other():
    assert list(in_other_forms(JointState(1), Term("coulomb_friction.torque_nm", 0, 1e-3))) == []
