"""Motors whose temperature was recorded."""

import numpy as np
import pytest

from sim_backend.effects.actuation import temperature_rise_k
from sim_backend.reality_gap.knowledge.joint_effects import MOTOR_LOSS, MOTOR_RISE, MOTOR_WARMS_S
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.heating import measured_warmth_k, with_measured_heat
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from tests.unit.sim_backend.reality_gap.synthetic_arm import STEP_S, arm, motion, recorded

RISE_K_NM2, WARMS_S = 1.0, 20.0


def warmed(torque, begins_k, rise=RISE_K_NM2, time_constant_s=WARMS_S, step_s=STEP_S):
    """Rise of one motor's temperature, shape (s,)."""
    found, now = np.empty(len(torque)), begins_k
    for i, each in enumerate(torque):
        found[i] = now = temperature_rise_k(now, each, rise, time_constant_s, step_s)
    return found


def heat_of(warmth, torque, start=None):
    """Rise and time constant of one motor that a study begins with."""
    state = with_measured_heat(start or JointState(1), [torque[None]], [warmth[None]], [STEP_S])
    return float(state.value(MOTOR_RISE)[0]), float(state.value(MOTOR_WARMS_S)[0])


def test_how_a_motor_heats_is_seen_in_its_temperature():
    torque = motion(3, 30.0)[1][:, 0]
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(torque))
    assert heat_of(warmed(torque, 12.0) + noise, torque) == pytest.approx((RISE_K_NM2, WARMS_S), rel=0.05)


def test_a_motor_that_hardly_gets_warmer_is_in_balance():
    torque = np.sin(np.arange(5000) / 50.0)
    rise, time_constant_s = heat_of(np.full(5000, 24.0), torque)
    assert rise * np.mean(torque**2) == pytest.approx(24.0) and time_constant_s == 3600.0


def test_a_stated_time_constant_stays_and_the_rise_is_fitted_beside_it():
    torque = motion(3, 30.0)[1][:, 0]
    stated = JointState(1, {MOTOR_WARMS_S: np.array([WARMS_S])})
    assert heat_of(warmed(torque, 12.0), torque, stated) == (pytest.approx(RISE_K_NM2, rel=0.01), WARMS_S)


def test_what_was_stated_stays_and_what_nobody_measured_is_usual():
    stated = JointState(1, {MOTOR_RISE: np.array([500.0])})
    torque = motion(3, 5.0)[1][:, 0]
    assert heat_of(warmed(torque, 12.0), torque, stated)[0] == 500.0
    assert heat_of(np.full(len(torque), np.nan), torque) == heat_of(np.full(len(torque), np.nan), torque, JointState(1))
    assert with_measured_heat(JointState(1), [torque[None]], [None], [STEP_S]).given == {}


def test_gaps_of_a_temperature_are_filled_and_a_motor_without_one_has_none():
    rises = np.column_stack([np.arange(6.0), np.full(6, np.nan)])
    rises[[0, 3], 0] = np.nan
    joints = JointSignals(("a", "b"), np.zeros((6, 2)), temperature_rise_k=rises)
    found = measured_warmth_k(joints)
    assert found is not None
    np.testing.assert_array_equal(found[0], [1.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert np.isnan(found[1]).all()


def test_a_loss_for_each_kelvin_is_named_by_the_temperature_that_was_recorded():
    """The motor begins warm, as nobody knows who has no temperature."""
    loss, recordings = 0.006, []
    for seed, begins_k in ((1, 60.0), (2, 5.0), (3, 35.0)):
        position, needed = motion(seed, 8.0)
        sent = needed.copy()
        for _ in range(20):  # what was sent is what was needed and what the motor lost of it
            rise = warmed(sent[:, 0], begins_k)
            sent[:, 0] = needed[:, 0] / (1.0 - loss * rise)
        temperature = np.column_stack([rise, np.full(len(rise), np.nan)])
        recordings.append(recorded(position, sent, f"r{seed}", temperature_rise_k=temperature))
    study = study_joints(arm(), recordings, lambda *_: None, robot=UnknownRobot())
    assert {a.effect for a in study.fit.accepted} == {"thermal_derating"}
    assert float(study.fit.state.value(MOTOR_LOSS)[0]) == pytest.approx(loss, rel=0.1)
    told = float(study.start.value(MOTOR_RISE)[0]), float(study.start.value(MOTOR_WARMS_S)[0])
    assert told == pytest.approx((RISE_K_NM2, WARMS_S), rel=0.2)
