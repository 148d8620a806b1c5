"""Each effect of sensing does what it says, to what is measured and to the driver that acts on it."""

import numpy as np
import pytest

from tests.unit.sim_backend.effects.rig import MID_RAD, UNDAMPED, WEIGHTLESS, c, go_to, rig, run


def test_an_encoder_offset_shifts_what_is_measured_and_where_the_driver_goes():
    offset = np.linspace(-0.1, 0.1, 9)
    segment = go_to(rig(WEIGHTLESS | {"encoder_offset.offset_rad": offset[None]}), MID_RAD, 1500)
    assert segment.joint_position_rad[0] == pytest.approx(segment.true_joint_position_rad[0] + offset)
    assert segment.true_joint_position_rad[0, -1] == pytest.approx(MID_RAD - offset, abs=2e-3)


def test_an_encoder_jump_comes_on_top():
    values = {"encoder_offset.offset_rad": 0.05, "encoder_jump.offset_rad": 0.3}
    segment = run(rig(values), 0.0, 5)
    assert segment.joint_position_rad == pytest.approx(segment.true_joint_position_rad + 0.35)


def test_quantised_positions_are_whole_steps():
    step = 0.004
    segment = run(rig({"encoder_quantisation.step_rad": step}), 0.1, 500)
    counts = segment.joint_position_rad / step
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert np.abs(segment.joint_position_rad - segment.true_joint_position_rad).max() <= step / 2 + 1e-12
    assert len(np.unique(counts.round())) > 10


def test_a_velocity_filter_lags_by_its_time_constant():
    time_s = 0.02
    segment = run(rig(WEIGHTLESS | {"velocity_filter.time_constant_s": time_s}), 0.05, 300)
    true, expected = segment.true_joint_velocity_rad_s[0], np.zeros(9)
    for k in range(300):
        expected = expected + 0.001 / (time_s + 0.001) * (true[k] - expected)
        assert segment.joint_velocity_rad_s[0, k] == pytest.approx(expected, abs=1e-12)


def test_joint_noise_has_the_stated_deviation_and_reaches_the_driver():
    values = {"joint_noise.position_rad": 0.01, "joint_noise.velocity_rad_s": 0.1, "joint_noise.torque_nm": 0.005}
    segment = run(rig(values, 20), 0.0, 500)
    pairs = {
        0.01: segment.joint_position_rad - segment.true_joint_position_rad,
        0.1: segment.joint_velocity_rad_s - segment.true_joint_velocity_rad_s,
        0.005: segment.measured_torque_nm - segment.applied_torque_nm,
    }
    for std, error in pairs.items():
        assert error.std() == pytest.approx(std, rel=4 / np.sqrt(2 * error.size))
        assert abs(error.mean()) < 4 * std / np.sqrt(error.size)
        neighbours = np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]
        assert abs(neighbours) < 4 / np.sqrt(error.size)
    damped = -c.SAFETY_DAMPING_NM_S_RAD * segment.joint_velocity_rad_s
    assert segment.applied_torque_nm == pytest.approx(damped, abs=1e-12)


def test_episode_noise_stays_within_a_trial_and_differs_between_trials():
    values = {"joint_episode_noise.position_rad": 0.01, "joint_episode_noise.velocity_rad_s": 0.05} | UNDAMPED
    segment = run(rig(values, 500), 0.0, 3)
    position = segment.joint_position_rad - segment.true_joint_position_rad
    velocity = segment.joint_velocity_rad_s - segment.true_joint_velocity_rad_s
    for std, error in ((0.01, position), (0.05, velocity)):
        assert np.ptp(error, axis=1).max() < 1e-12
        assert error[:, 0].std() == pytest.approx(std, rel=4 / np.sqrt(2 * 500 * 9))


def test_a_restarting_controller_sends_nothing():
    driver = rig({})
    run(driver, 0.2, 10)
    driver.set_physics(driver.physics.changed({"controller_restart.off": 1.0}))
    off = run(driver, 0.2, 10)
    assert (off.applied_torque_nm == 0.0).all() and (off.desired_torque_nm == 0.2).all()
