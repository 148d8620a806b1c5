"""How warm motors are where windows of a recording begin."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.past import Past, warming, warms
from sim_backend.reality_gap.subjects.joints.laws.state import JointState

RISE_K_NM2, WARMS_S, LIMIT_NM, STEP_S = 40.0, 5.0, 2.0, 0.01


def test_a_motor_warms_as_an_exponential_up_to_its_limit_and_recordings_begin_cold():
    steady = np.stack([np.full(2000, 1.5), np.full(2000, 9.0), np.full(2000, 9.0)])
    first = np.array([0, 500, 1999, 0])
    past = Past([steady, steady], [None, None], [STEP_S, STEP_S], np.array([0, 0, 0, 1]), first)
    loss = np.array([0.001, 0.001, 0.0])
    numbers = {"rise_k_nm2": RISE_K_NM2, "time_constant_s": WARMS_S}
    given = {f"thermal_derating.{name}": np.full(3, value) for name, value in numbers.items()}
    limit = {"torque_saturation.limit_nm": np.full(3, LIMIT_NM)}
    state = JointState(3, {"thermal_derating.loss_per_k": loss, **given, **limit})
    reached = 1.0 - np.exp(-first * STEP_S / WARMS_S)
    expected = RISE_K_NM2 * reached[:, None] * np.array([1.5, LIMIT_NM, 0.0]) ** 2
    assert past.warm_k(state) == pytest.approx(expected)
    assert past.some(np.array([1])).warm_k(state) == pytest.approx(expected[1:2])


def test_a_motor_whose_temperature_was_measured_begins_a_window_as_warm_as_it_was():
    torque, measured = np.full((2, 100), 1.5), np.stack([np.linspace(20.0, 30.0, 100), np.full(100, np.nan)])
    given = {"loss_per_k": 0.001, "rise_k_nm2": RISE_K_NM2, "time_constant_s": WARMS_S}
    state = JointState(2, {f"thermal_derating.{name}": np.full(2, value) for name, value in given.items()})
    warm = Past([torque], [measured], [STEP_S], np.array([0, 0]), np.array([0, 99])).warm_k(state)
    np.testing.assert_array_equal(warm[:, 0], [20.0, 30.0])
    assert warm[0, 1] == 0.0 and 0.0 < warm[1, 1] < 30.0


def test_models_warm_alike_where_all_that_heats_them_is_the_same():
    given = {f"thermal_derating.{name}": np.full(2, value) for name, value in (("loss_per_k", 0.001), ("rise_k_nm2", 9.0))}
    state = JointState(2, given)
    other_friction = JointState(2, given | {"coulomb_friction.torque_nm": np.full(2, 0.1)})
    assert warming(state) == warming(other_friction)
    for name, value in (("rise_k_nm2", 8.0), ("loss_per_k", 0.002), ("time_constant_s", 3.0)):
        assert warming(state) != warming(JointState(2, given | {f"thermal_derating.{name}": np.full(2, value)}))
    assert warms(state) and not warms(JointState(2))
