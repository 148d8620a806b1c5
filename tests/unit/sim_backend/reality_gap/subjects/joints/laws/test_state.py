"""What the catalogue bounds in N m goes with the size of a robot; shares, angles and times do not."""

import numpy as np
import pytest

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.joints.laws.moves import moved, within_bounds
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term, values_of

COULOMB, OFFSET, LIMIT = "coulomb_friction.torque_nm", "encoder_offset.offset_rad", "torque_saturation.limit_nm"


def test_a_robot_ten_times_as_strong_may_have_ten_times_the_friction():
    small, large = JointState(2), JointState(2, size=10.0)
    upper = PARAMETERS[COULOMB].upper
    assert small.bounds(COULOMB) == (0.0, upper)
    assert large.bounds(COULOMB) == (0.0, 10.0 * upper)
    assert large.bounds(OFFSET) == (PARAMETERS[OFFSET].lower, PARAMETERS[OFFSET].upper)
    assert large.bounds(LIMIT)[0] == PARAMETERS[LIMIT].lower  # a weak motor may stay weak
    term, value, error = [Term(COULOMB, 1, 1e-3)], np.array([5.0 * upper]), np.array([1e-3])
    assert within_bounds(term, value, error, large)
    assert not within_bounds(term, value, error, small)
    assert moved(large, term, value).value(COULOMB)[1] == pytest.approx(5.0 * upper)
    assert moved(small, term, value).value(COULOMB)[1] == pytest.approx(upper)


def test_size_stays_with_the_state():
    state = JointState(2, size=3.0).moved(Term(COULOMB, 0, 1e-3), 0.1)
    assert (state.size, state.value(COULOMB)[0]) == (3.0, 0.1)


def test_inertias_are_bounded_by_the_arms_own_and_torques_by_its_torques():
    state = JointState(1, size=9.0, inertia_size=60.0)
    assert state.bounds("rotor_inertia.armature_kg_m2")[1] == 60.0 * JointState(1).bounds("rotor_inertia.armature_kg_m2")[1]
    assert state.bounds("coulomb_friction.torque_nm")[1] == 9.0 * JointState(1).bounds("coulomb_friction.torque_nm")[1]
    assert state.bounds("link_mass.factor") == JointState(1).bounds("link_mass.factor")


def test_some_values_take_the_place_of_others():
    state = JointState(2).moved(Term(COULOMB, 0, 1e-3), 0.1).with_values({(COULOMB, 1): 0.2, (OFFSET, 0): 0.03})
    assert state.value(COULOMB).tolist() == [0.1, 0.2]
    assert state.value(OFFSET).tolist() == [0.03, 0.0]


def test_values_of_some_models_are_those_of_each_whether_they_were_given_or_not():
    clock, states = "clock.offset_s", [JointState(3, {COULOMB: np.array([0.1, 0.2, 0.3])}), JointState(3)]
    for key in (COULOMB, OFFSET, LIMIT, clock):
        for some in (states, states[1:]):
            np.testing.assert_array_equal(values_of(some, key), [state.value(key) for state in some])
