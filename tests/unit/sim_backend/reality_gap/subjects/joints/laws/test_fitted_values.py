"""What a fit moved, as the numbers that a model of the robot needs."""

import numpy as np
import pytest

from sim_backend.effects.actuation import temperature_rise_k
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import fitted_values
from sim_backend.reality_gap.subjects.joints.laws.moves import deviations, moved
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

LOSS, RISE, CONSTANT = (f"thermal_derating.{name}" for name in ("loss_per_k", "rise_k_nm2", "time_constant_s"))
NOMINAL = JointState(2)
ERRORS = np.array([0.1, 0.2])


def told(values):
    return {(v.key, v.index): (v.value, v.error) for v in values}


def heated(loss, size=1.0):
    """A state as a fit with the shape that heat is looked for with leaves it, and its terms."""
    start = JointState(2, size=size)
    term = Term(LOSS, 1, 1e-5, ((CONSTANT, 30.0), (RISE, 2000.0)))
    return start, start.moved(term, loss), (Term(LOSS, 1, 1e-5), Term(CONSTANT, 1, 0.1))


def pair(key, place, values):
    return tuple(Term(key, 1, 1e-3, ((place, value),)) for value in values)


def test_a_loss_is_told_for_the_temperature_that_motors_reach():
    start, state, terms = heated(0.0008)
    found = told(fitted_values(start, state, terms, np.array([0.0001, 2.0])))
    assert found == {
        (LOSS, 1): pytest.approx((0.01, 0.00125)),
        (CONSTANT, 1): pytest.approx((30.0, 2.0)),
    }
    losses = []
    for loss, rise in ((found[LOSS, 1][0], PARAMETERS[RISE].absent), (0.0008, 2000.0)):
        warm = 0.0
        for _ in range(1000):
            warm = temperature_rise_k(warm, 0.3, rise, 30.0, 0.01)
        losses.append(loss * warm)
    assert losses[0] == pytest.approx(losses[1], rel=1e-9), "the model loses the torque that the fit did"


@pytest.mark.parametrize(("fitted", "rise"), [(0.01, 2000.0), (0.002, 400.0)])
def test_a_loss_that_no_motor_has_is_told_as_half_of_the_largest_with_its_rise(fitted: float, rise: float):
    start, state, terms = heated(fitted)
    found = told(fitted_values(start, state, terms, np.array([0.1 * fitted, 2.0])))
    assert found[LOSS, 1] == pytest.approx((0.01, 0.001))
    assert found[RISE, 1] == pytest.approx((rise, 0.0))


def test_a_larger_robot_gets_as_warm_from_its_own_torques():
    start, state, terms = heated(0.0008 / 100.0, size=10.0)
    found = told(fitted_values(start, state, terms, np.array([1e-6, 2.0])))
    assert found[LOSS, 1][0] == pytest.approx(0.01)
    assert found[RISE, 1] == pytest.approx((PARAMETERS[RISE].absent / 100.0, 0.0))


@pytest.mark.parametrize(
    ("key", "place", "shapes", "values", "size", "where"),
    [
        ("joint_stiffness.stiffness_nm_rad", "joint_stiffness.reference_rad", (-2.0, 1.0), (0.02, 0.01), 0.03, -1.0),
        ("cogging.amplitude_nm", "cogging.phase_rad", (0.0, np.pi / 2), (0.03, 0.04), 0.05, np.arctan2(4, 3)),
    ],
)
def test_two_images_are_told_as_a_size_and_a_place(key, place, shapes, values, size, where):
    terms = pair(key, place, shapes)
    state = moved(NOMINAL, terms, np.array(values))
    found = told(fitted_values(NOMINAL, state, terms, 0.01 * ERRORS))
    assert {name: value for name, (value, _) in found.items()} == {
        (key, 1): pytest.approx(size),
        (place, 1): pytest.approx(where),
    }
    nudged = [moved(NOMINAL, terms, np.array(values) + 1e-6 * step) for step in np.eye(2)]
    for name in (key, place):
        slopes = [(state_.value(name)[1] - state.value(name)[1]) / 1e-6 for state_ in nudged]
        assert found[name, 1][1] == pytest.approx(float(np.hypot(*(slopes * ERRORS * 0.01))), rel=1e-3)
    assert deviations(state, NOMINAL, terms) == pytest.approx(values)


def test_other_numbers_are_told_as_they_are():
    term = Term("viscous_friction.damping_nm_s_rad", 0, 1e-4)
    (found,) = fitted_values(NOMINAL, moved(NOMINAL, (term,), np.array([0.01])), (term,), np.array([0.002]))
    assert (found.key, found.index, found.value, found.error) == (term.key, 0, pytest.approx(0.01), 0.002)
