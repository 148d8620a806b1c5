"""What joints show without a fit."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.joint_effects import Sign
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.measured.sensor_noise import encoder_step
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.signs.checks import (
    Finding,
    beside_jumps,
    end_findings,
    fault_findings,
    jump_in,
    noise_findings,
    noise_of_clocks,
    place,
    torque_noise_findings,
)
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NAMES, NO_LIMIT, drive, episode, joints_model

ENCODER_RAD = 5e-5


TRIFINGER = KnownTriFinger(NO_SESSIONS)


@pytest.fixture(scope="module")
def motion():
    position, torque = drive(joints_model(), 4.0)
    return position + ENCODER_RAD * np.random.default_rng(0).standard_normal(position.shape), torque


def noise(motion, sigma, seed=1):
    return sigma * np.random.default_rng(seed).standard_normal(motion[0].shape)


def names(findings):
    return [(f.effect, f.parameter, f.joint) for f in findings]


def test_a_healthy_motion_shows_nothing(motion):
    velocity = np.gradient(motion[0], 1e-3, axis=0)
    whole = episode(*motion, velocity_rad_s=velocity, measured_torque_nm=motion[1] + noise(motion, 0.003))
    assert noise_findings([whole], TRIFINGER) == []
    assert fault_findings([whole]) == []
    assert end_findings([whole], NO_LIMIT) == []
    assert torque_noise_findings([whole], NO_LIMIT, np.ones(3), np.full(3, 0.05)) == []


def test_a_noisy_encoder_is_odd_among_others_and_all_are_beyond_what_is_healthy(motion):
    found = noise_findings([episode(motion[0] + noise(motion, np.array([0.0, 4e-4, 0.0])), motion[1])], TRIFINGER)
    assert names(found) == [("joint_noise", "position_rad", 1)]
    assert found[0].value == pytest.approx(4e-4, rel=0.1)
    low, high = found[0].interval_90
    assert low < found[0].value < high
    found = noise_findings([episode(motion[0] + noise(motion, 3e-3), motion[1])], TRIFINGER)
    assert names(found) == [("joint_noise", "position_rad", None)]
    assert found[0].value == pytest.approx(3e-3, rel=0.05)


def test_of_sensors_that_nobody_knows_only_a_single_joint_can_be_odd(motion):
    def found(sigma):
        return names(noise_findings([episode(motion[0] + noise(motion, np.array(sigma)), motion[1])], UnknownRobot()))

    assert found([0.0, 4e-4, 0.0]) == [], "another encoder than its neighbours'"
    assert found([3e-3, 3e-3, 3e-3]) == [], "as all of this robot's may be"
    assert found([0.0, 3e-3, 0.0]) == [("joint_noise", "position_rad", 1)]
    assert found([0.0, 8e-4, 0.0]) == [("joint_noise", "position_rad", 1)], "small, but 16 times as large as its neighbours'"


def test_of_two_joints_the_odd_one_is_said_not_both(motion):
    two, torque = motion[0][:, 1:].copy(), motion[1][:, 1:]
    noisy = two + noise(motion, np.array([0.0, 4e-3, 0.0]))[:, :2]  # of its second joint
    two[:, 1] = 6e-3 * np.round(two[:, 1] / 6e-3)
    assert names(noise_findings([episode(two, torque)], UnknownRobot())) == [("encoder_quantisation", "step_rad", 1)]
    assert names(noise_findings([episode(noisy, torque)], UnknownRobot())) == [("joint_noise", "position_rad", 1)]


def test_times_of_rows_that_are_not_exact_are_no_noise_of_the_quickest_joint():
    time_s, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(3)

    def positions(at_s):
        return np.stack([0.4 * np.sin(4.0 * at_s), 0.8 * np.sin(20.0 * at_s), 0.3 * np.sin(2.0 * at_s)], axis=1)

    late = positions(time_s + np.abs(2e-3 * rng.standard_normal(len(time_s))))
    noisy = positions(time_s) + np.array([1e-4, 9e-3, 1e-4]) * rng.standard_normal(late.shape)
    of_clock, of_sensor = (episode(read, np.zeros_like(read)) for read in (late, noisy))
    assert noise_findings([of_clock], UnknownRobot()) == []
    assert noise_of_clocks([of_clock]) == {1: pytest.approx(9e-3, rel=0.3)}
    assert names(noise_findings([of_sensor], UnknownRobot())) == [("joint_noise", "position_rad", 1)]
    assert noise_of_clocks([of_sensor]) == {}
    steps_rad = 2.0 * np.pi / 2**12
    coarse = steps_rad * np.round(positions(time_s) / steps_rad)
    assert noise_of_clocks([episode(coarse, np.zeros_like(coarse))]) == {}, (
        "steps are no noise, and nothing would be said of them"
    )


def test_motion_between_few_samples_is_no_noise():
    time_s = np.arange(0.0, 20.0, 0.05)
    quick = np.stack([0.5 * np.sin(2 * np.pi * hz * time_s) for hz in (0.5, 0.5, 2.0)], axis=1)
    samples = np.linspace(0.0, len(time_s) - 1.0, 20_000)
    held = np.stack([np.interp(samples, np.arange(len(time_s)), column) for column in quick.T], axis=1)
    slow = episode(held, np.zeros_like(held), position_step_s=np.full(3, 0.05))
    assert names(noise_findings([slow], TRIFINGER)) == [("joint_noise", "position_rad", 2)]
    assert noise_findings([slow], UnknownRobot()) == []


def test_joints_that_are_recorded_slower_are_not_quieter(motion):
    position, samples = motion[0].copy(), np.arange(len(motion[0]))
    for joint in (1, 2):
        position[:, joint] = np.interp(samples, samples[::5], motion[0][::5, joint])
    slow = episode(position, motion[1], position_step_s=np.array([1e-3, 5e-3, 5e-3]))
    assert noise_findings([slow], TRIFINGER) == []
    assert (slow.path.position_noise_rad > 0.9 * ENCODER_RAD * np.sqrt([1.0, 5.0, 5.0])).all()


def test_noise_of_velocities(motion):
    velocity = np.gradient(motion[0], 1e-3, axis=0) + noise(motion, np.array([0.0, 0.0, 0.6]))
    found = noise_findings([episode(*motion, velocity_rad_s=velocity)], TRIFINGER)
    assert names(found) == [("joint_noise", "velocity_rad_s", 2)]
    assert found[0].value == pytest.approx(0.6, rel=0.1)


def test_steps_of_an_encoder(motion):
    coarse = motion[0].copy()
    coarse[:, 2] = 2e-3 * np.round(coarse[:, 2] / 2e-3)
    np.testing.assert_allclose(encoder_step(coarse), [0.0, 0.0, 2e-3], rtol=1e-3)
    found = noise_findings([episode(coarse, motion[1])], TRIFINGER)
    assert names(found) == [("encoder_quantisation", "step_rad", 2)]
    assert found[0].value == pytest.approx(2e-3, rel=1e-3)


def test_steps_are_odd_beside_those_of_joints_of_the_same_kind(motion):
    coarse = 2e-3 * np.round(motion[0] / 2e-3)
    coarse[:, 1:] = motion[0][:, 1:]
    whole = episode(coarse, motion[1])

    def seen(is_slide: list[bool]) -> list[Finding]:
        some = slice(len(is_slide))
        joints = JointSignals(NAMES[some], coarse[:, some])
        path = SimpleNamespace(joints=joints, encoder_step_rad=encoder_step(coarse[:, some]), by_own_samples=lambda of, x: of(x))
        return noise_findings([SimpleNamespace(path=path, plant=SimpleNamespace(is_slide=np.array(is_slide)))], UnknownRobot())

    assert names(noise_findings([whole], UnknownRobot())) == [("encoder_quantisation", "step_rad", 0)]
    assert names(seen([False, False])) == names(seen([False, False, True])) == [("encoder_quantisation", "step_rad", 0)]
    assert seen([False]) == seen([False, True]) == seen([True, False, False]) == []


def test_an_encoder_that_rests_comes_in_no_steps():
    assert encoder_step(np.zeros((100, 2))).tolist() == [0.0, 0.0]


def test_torque_noise_that_a_joint_does_not_feel_is_the_sensors(motion):
    whole = episode(*motion, measured_torque_nm=motion[1] + noise(motion, np.array([0.001, 0.03, 0.001])))
    sensed = torque_noise_findings([whole], NO_LIMIT, np.ones(3), np.full(3, 0.05))
    felt = torque_noise_findings([whole], NO_LIMIT, np.zeros(3), np.full(3, 0.05))
    assert names(sensed) == [("joint_noise", "torque_nm", 1)]
    assert names(felt) == [("action_noise", "white_nm", 1)]
    for found in (sensed, felt):
        assert found[0].value == pytest.approx(0.03, rel=0.1)
    assert torque_noise_findings([episode(*motion)], NO_LIMIT, np.ones(3), np.ones(3)) == []


@pytest.mark.parametrize("size", (0.02, -0.005))
def test_a_jump_is_found_when_it_came(motion, size):
    jumped = motion[0].copy()
    jumped[2500:, 1] += size
    found = fault_findings([episode(*motion), episode(jumped, motion[1])])
    assert names(found) == [("encoder_jump", "offset_rad", 1)]
    assert found[0].value == pytest.approx(size, abs=5 * ENCODER_RAD)
    assert (found[0].episode, found[0].sample) == (1, 2500)


def test_an_end_of_a_joint_whose_encoder_jumped_is_shifted_by_more_than_the_jump(motion):
    jumped = motion[0].copy()
    jumped[2500:, 1] += 0.02
    jump = fault_findings([episode(jumped, motion[1])])
    near, far, elsewhere = (Finding(Sign.LOWER_END, *at, (0.0, 0.0), 3.0) for at in ((1, -0.018), (1, -0.05), (2, -0.018)))
    assert beside_jumps([*jump, near, far, elsewhere]) == [*jump, far, elsewhere]
    assert beside_jumps([near]) == [near]


def test_a_coarse_encoder_that_moves_on_by_a_step_has_not_jumped(motion):
    step, coarse = 0.004, motion[0].copy()
    coarse[:, 1] = step * np.round(0.2 * coarse[:, 1] / step)  # a joint that moves little passes a step now and then
    assert np.abs(np.diff(coarse[:, 1])).max() == pytest.approx(step)
    assert fault_findings([episode(coarse, motion[1])]) == []


def test_a_spike_is_no_jump(motion):
    spiked = motion[0].copy()
    spiked[2500, 1] += 0.02
    assert fault_findings([episode(spiked, motion[1])]) == []


@pytest.mark.parametrize("repeated", (3, 8))
@pytest.mark.parametrize("noise_rad", (0.0, 5e-5))
def test_positions_that_catch_up_after_repeated_ones_are_no_jump(motion, repeated, noise_rad):
    stale = motion[0].copy()
    at = int(np.argmax(np.abs(np.gradient(stale[1000:3000, 1])))) + 1000
    stale[at : at + repeated + 1, 1] = stale[at, 1] + noise_rad * np.random.default_rng(4).standard_normal(repeated + 1)
    missed = stale[at + repeated + 1, 1] - stale[at, 1]
    assert abs(missed) > 2.5e-3, "as large as a jump"
    assert fault_findings([episode(stale, motion[1])]) == []
    stale[at + repeated + 1 :, 1] += 4.0 * missed
    assert names(fault_findings([episode(stale, motion[1])])) == [("encoder_jump", "offset_rad", 1)]


@pytest.mark.parametrize(
    "speeds_rad_s", [(2.0, 0.1, 0.1), (2.0, -0.2, -0.2), (5.5, 20.0, 0.2)], ids=["slower", "turned", "faster"]
)
def test_a_joint_that_changed_its_speed_while_its_reading_stood_still_has_not_jumped(speeds_rad_s):
    """Its controller was told that it stood, and then how far it had come."""
    speed_rad_s = np.interp(np.arange(2000), [1000, 1050, 1060], speeds_rad_s)
    position = 1e-3 * np.cumsum(speed_rad_s) + 3e-5 * np.random.default_rng(5).standard_normal(2000)
    position[1000:1051] = position[1000]
    assert position[1051] - position[1050] > 0.03
    assert jump_in(position, 0.0) is None
    position[1051:] += 4.0
    assert jump_in(position, 0.0) is not None


def test_a_joint_that_is_pushed_and_does_not_move_is_stuck(motion):
    held = motion[0].copy()
    held[:, 0] = 0.3
    found = fault_findings([episode(held, motion[1])])
    assert names(found) == [("stuck_joint", "holding_torque_nm", 0)]
    assert fault_findings([episode(held, motion[1] * [0.001, 1.0, 1.0])]) == []


@pytest.mark.parametrize("shift", (-0.05, 0.03))
def test_an_end_where_a_joint_is_held_although_it_presses(motion, shift):
    position, torque = (part.copy() for part in motion)
    position[1000:2500, 2] = 1.5 + shift
    torque[1000:2500, 2] = 0.2
    found = end_findings([episode(position, torque)], NO_LIMIT)
    assert names(found) == [("joint_limits", "upper_rad", 2)]
    assert found[0].value == pytest.approx(shift, abs=3e-3)
    torque[1000:2500, 2] = -0.2
    assert end_findings([episode(position, torque)], NO_LIMIT) == []


def test_an_end_is_seen_through_an_encoder_that_is_off(motion):
    position, torque = (part.copy() for part in motion)
    position[1000:2500, 2] = 1.53
    torque[1000:2500, 2] = 0.2
    off = NO_LIMIT.given | {"encoder_offset.offset_rad": np.array([0.0, 0.0, 0.03])}
    assert end_findings([episode(position, torque)], type(NO_LIMIT)(3, off)) == []


def test_places_have_names():
    assert place(NAMES, 1) == "second"
    assert place(NAMES, None) == "all joints"
