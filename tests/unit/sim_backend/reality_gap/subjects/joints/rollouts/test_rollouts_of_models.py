"""Windows of a known pendulum are simulated as MuJoCo alone does."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.past import Past
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Forward, Windows, _warm
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS, windows_of
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import (
    NO_LIMIT,
    PENDULUM,
    STEP_S,
    one_window,
    recorded,
    targets,
)


@pytest.mark.parametrize("more", ['damping="0.02"', 'frictionloss="0.05"', 'damping="0.01" frictionloss="0.03"'])
def test_a_window_goes_where_mujoco_goes(more):
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=more))
    data = mujoco.MjData(model)
    sent, went = 0.7 * np.sin(0.08 * np.arange(120.0))[None, :, None], np.empty((1, 120, 1))
    for i in range(120):
        data.ctrl[0] = sent[0, i, 0]
        for _ in range(10):
            mujoco.mj_step(model, data)
        went[0, i] = data.qpos[0]
    plant = Plant(model, ["hinge"])
    own = {key: values for key, values in plant.own_values.items() if values.any()}
    window = one_window(went, sent)
    found = Forward(plant, STEP_S).positions(
        window, window.begin_rad, window.begin_rad_s, [JointState(1, own | NO_LIMIT)], np.zeros(1, int)
    )
    assert np.abs(found - went).max() < 0.02 * np.abs(went).max()


def test_in_the_loop_a_servo_stops_where_its_torque_and_gravity_are_even():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='damping="0.1"'))
    samples, stall_nm = 1200, 0.5
    law = [np.full((1, samples, 1), value) for value in (1.0, 5.0, 0.0, stall_nm, 0.02, 0.0, 1.0)]
    window = one_window(np.zeros((1, samples, 1)), np.full((1, samples, 1), np.nan), Feedback(*law))
    state = JointState(1, {"viscous_friction.damping_nm_s_rad": np.array([0.1]), **NO_LIMIT})
    forward = Forward(Plant(model, ["hinge"]), STEP_S)
    rests = forward.positions(window, window.begin_rad, window.begin_rad_s, [state], np.zeros(1, int))[0, -1, 0]
    asked = min(5.0 * (1.0 - rests), stall_nm)
    assert asked == pytest.approx(0.6 * 9.81 * 0.15 * np.sin(rests), rel=1e-3)


def went_on_board(law: Feedback, lead: int, late_s: float, *, own_steps: bool, held_s: float = 0.0) -> np.ndarray:
    """Where the pendulum goes from rest, shape (s,), with a loop beside its motor of which ``lead`` samples before are known."""
    plant = Plant(mujoco.MjModel.from_xml_string(PENDULUM.format(more="")), ["hinge"])
    nothing = np.zeros((1, law.target_rad.shape[1] - lead, 1))
    window = replace(one_window(nothing, nothing, law), lead=lead)
    forward = Forward(plant, STEP_S, held_s=held_s, longest_step_s=0.001)
    if not own_steps:
        forward._chain = None
    state = JointState(1, {"action_delay.delay_s": np.array([late_s]), **NO_LIMIT})
    return forward.positions(window, window.begin_rad, window.begin_rad_s, [state], np.zeros(1, int))[0, :, 0]


def law_on_board(target: np.ndarray, desired: np.ndarray) -> Feedback:
    nothing = np.zeros_like(target)
    return Feedback(target, nothing + 5.0, nothing + 0.1, nothing + np.inf, nothing + 0.02, desired, nothing + 1.0)


@pytest.mark.parametrize("own_steps", [True, False])
@pytest.mark.parametrize("what", ["target", "voltage"])
def test_what_was_asked_for_before_a_window_comes_within_it(what, own_steps):
    lead, behind, at = 20, 7, np.arange(220)[None, :, None]
    asked, nothing = np.sin(at / 12.0), np.zeros((1, 220, 1))
    late, in_time = (
        law_on_board(sent, nothing) if what == "target" else law_on_board(nothing, sent)
        for sent in (asked, np.roll(asked, behind, axis=1))
    )
    found = went_on_board(late, lead, behind * STEP_S, own_steps=own_steps)
    np.testing.assert_allclose(found, went_on_board(in_time.at((slice(None), slice(lead, None))), 0, 0.0, own_steps=own_steps))
    assert np.abs(found - went_on_board(late, lead, 0.0, own_steps=own_steps)).max() > 0.05


@pytest.mark.parametrize("own_steps", [True, False])
@pytest.mark.parametrize("late_s", [-0.002, 0.0, 0.0013, 0.004])
def test_a_loop_beside_its_motor_is_not_held_and_has_any_delay(late_s, own_steps):
    target = np.cumsum(np.random.default_rng(1).normal(size=(1, 120, 1)), axis=1) / 10.0
    law = law_on_board(target, np.zeros_like(target))
    found = went_on_board(law, 20, late_s, own_steps=own_steps)
    np.testing.assert_array_equal(found, went_on_board(law, 20, late_s, own_steps=own_steps, held_s=STEP_S))
    later = went_on_board(law, 20, late_s + 0.0005, own_steps=own_steps)
    assert 1e-5 < np.abs(found - later).max() < 0.02, "half a millisecond shows, and not as much as a row"


@pytest.mark.parametrize("own_steps", [True, False])
def test_a_torque_constant_is_that_of_the_motor_s_own_voltage_too(own_steps):
    """Torque is kt V / R - kt^2 speed / R, whatever kt is."""
    model, samples, less = mujoco.MjModel.from_xml_string(PENDULUM.format(more="")), 200, 0.8
    voltage = 6.0 * np.sin(np.arange(samples) / 15.0)[None, :, None]
    plant, nominal = Plant(model, ["hinge"]), JointState(1, NO_LIMIT)

    def went(kt: float, state: JointState) -> np.ndarray:
        nothing = np.zeros((1, samples, 1))
        law = Feedback(nothing, nothing, nothing, nothing + np.inf, nothing + kt**2 / 2.0, kt * voltage / 2.0, nothing + 1.0)
        window = one_window(nothing, np.full((1, samples, 1), np.nan), law)
        forward = Forward(plant, STEP_S)
        if not own_steps:
            forward._chain = None
        return forward.positions(window, window.begin_rad, window.begin_rad_s, [state], np.zeros(1, int))[0, :, 0]

    weaker = JointState(1, {"torque_constant.error": np.array([less - 1.0]), **NO_LIMIT})
    np.testing.assert_allclose(went(0.3, weaker), went(less * 0.3, nominal), atol=1e-9)
    assert np.abs(went(0.3, nominal) - went(less * 0.3, nominal)).max() > 0.05


@pytest.mark.parametrize("is_held", [True, False])
def test_in_the_loop_a_controller_holds_its_torque_for_a_row_or_computes_all_the_time(is_held):
    """Rows 20 ms apart at which a damping of 0.4 N m s/rad shakes the joint, if torques are held, and only there."""
    model, row_s, samples = mujoco.MjModel.from_xml_string(PENDULUM.format(more="")), 0.02, 40
    data = mujoco.MjData(model)
    went = np.empty(samples)
    for i in range(samples):
        for now in range(round(row_s / model.opt.timestep)):
            if now == 0 or not is_held:
                data.ctrl[0] = 6.0 * (0.3 - data.qpos[0]) - 0.4 * data.qvel[0]
            mujoco.mj_step(model, data)
        went[i] = data.qpos[0]
    law = [np.full((1, samples, 1), value) for value in (0.3, 6.0, 0.4, np.inf, 0.0, 0.0, 0.0)]
    window = replace(one_window(np.zeros((1, samples, 1)), np.full((1, samples, 1), np.nan), Feedback(*law)), step_s=row_s)
    plant, state = Plant(model, ["hinge"]), JointState(1, NO_LIMIT)

    def off(*, as_held: bool) -> float:
        """With the speed at the begin that fits best: steps of 2.5 ms know it half a step before."""
        forward, speeds = Forward(plant, row_s, held_s=row_s if as_held else 0.0), np.linspace(-0.5, 0.5, 101)[:, None]
        many = window.some(np.zeros(len(speeds), int))
        found = forward.positions(many, many.begin_rad, speeds, [state], np.zeros(len(speeds), int))
        return float(np.abs(found[:, :, 0] - went).max(axis=1).min())

    assert off(as_held=is_held) < 0.5 * off(as_held=not is_held)


def test_a_delayed_torque_comes_late():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    sent = np.zeros((2, 40, 1))
    sent[0, 4:], sent[1, 6:] = 0.3, 0.3
    window = replace(one_window(sent, sent), begin_rad=np.zeros((2, 1)), begin_rad_s=np.zeros((2, 1)), owner=np.zeros(2, int))
    prompt = JointState(1, NO_LIMIT)
    late = JointState(1, {"action_delay.delay_s": np.array([2 * STEP_S]), **NO_LIMIT})
    went = Forward(Plant(model, ["hinge"]), STEP_S).positions(
        window, window.begin_rad, window.begin_rad_s, [prompt, late], np.array([1, 0])
    )
    assert went[0] == pytest.approx(went[1], abs=1e-12) and np.abs(went).max() > 0.01


def test_windows_leave_out_what_was_not_measured():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recording = recorded(model, targets(8.0, 3))
    study = study_joints(model, [recording], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
    whole = windows_of(study.problem.episodes, 1.0, STEP_S, np.array([1e-4]))
    assert recording.joints is not None
    gone = recording.joints.position_rad.copy()
    gone[500:520] = np.nan
    broken = replace(recording, joints=replace(recording.joints, position_rad=gone))
    of_broken = study_joints(model, [broken], lambda *_: None, robot=UnknownRobot(), gate=np.inf).problem.episodes
    less = windows_of(of_broken, 1.0, STEP_S, np.array([1e-4]))
    assert len(whole) == 7 and len(less) == 6
    assert np.isfinite(less.position_rad).all() and np.isfinite(less.sent_nm).all()


@pytest.mark.parametrize("measured", [True, False], ids=["measured", "commanded"])
def test_windows_leave_out_when_nobody_knows_the_torque(measured):
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recording = recorded(model, targets(8.0, 3))
    assert recording.joints is not None and recording.joints.commanded_torque_nm is not None
    gone = recording.joints.commanded_torque_nm.copy()
    gone[500:900] = np.nan
    columns = {"commanded_torque_nm": None, "measured_torque_nm": gone} if measured else {"commanded_torque_nm": gone}
    joints = replace(recording.joints, **columns, feedback=None, not_recorded=())
    study = study_joints(model, [replace(recording, joints=joints)], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
    windows = windows_of(study.problem.episodes, 0.5, STEP_S, np.array([1e-4]))
    ends = windows.past.first + round(0.5 / STEP_S) if windows.past is not None else np.zeros(0)
    assert len(windows) and ((ends <= 500) | (windows.past.first >= 900)).all()


def test_windows_at_an_end_of_a_joint_are_left_out_where_enough_others_are_left():
    free = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recording = recorded(free, targets(8.0, 3))
    assert recording.joints is not None

    def windows(end_rad: float) -> Windows:
        limited = PENDULUM.format(more=f'limited="true" range="{-np.degrees(4.0)} {np.degrees(end_rad)}"')
        model = mujoco.MjModel.from_xml_string(limited)
        found = study_joints(model, [recording], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
        return windows_of(found.problem.episodes, 0.2, STEP_S, np.array([1e-4]))

    highest_rad, lowest_rad = (float(np.quantile(recording.joints.position_rad, share)) for share in (0.9, 0.2))
    whole, kept = windows(4.0), windows(highest_rad)
    assert LEAST_WINDOWS <= len(kept) < len(whole) and (kept.position_rad < highest_rad).all()
    assert len(windows(lowest_rad)) == len(whole)


def test_of_windows_in_which_every_joint_rests_there_are_few():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    rests = np.concatenate([targets(4.0, 3), np.full(1600, targets(4.0, 3)[-1])])
    recording = recorded(model, rests, noise_rad=0.0)
    episodes = study_joints(model, [recording], lambda *_: None, robot=UnknownRobot(), gate=np.inf).problem.episodes
    every, fewer, none = (windows_of(episodes, 1.0, STEP_S, np.array([noise_rad])) for noise_rad in (0.0, 1e-3, 10.0))
    assert len(every) == len(none) == 11, "where nothing moves there are no others"
    goes_rad = np.ptp(fewer.position_rad, axis=1)[:, 0]
    moving = int((np.ptp(every.position_rad, axis=1) > 1e-2).sum())
    assert 4 <= moving <= 6, "it settles within a second or two"
    assert (goes_rad > 1e-2).sum() == moving and len(fewer) == moving + moving // 2


def test_motors_begin_each_simulation_as_warm_as_its_model_makes_them():
    given = {"loss_per_k": 0.001, "rise_k_nm2": 40.0, "time_constant_s": 5.0}
    hot = {f"thermal_derating.{name}": np.array([value]) for name, value in given.items()}
    states = [JointState(1, hot | more) for more in ({}, {"encoder_offset.offset_rad": np.array([0.1])})]
    states += [JointState(1), JointState(1, hot | {"thermal_derating.rise_k_nm2": np.array([20.0])})]
    past = Past([np.full((1, 900), 1.5)], [None], [STEP_S], np.zeros(3, int), np.array([0, 300, 899]))
    still = np.zeros((3, 5, 1))
    windows = Windows(STEP_S, still, still[:, 0], still[:, 0], still, None, np.zeros(3, int), past)
    which, over = np.repeat(np.arange(4), 3), np.tile(np.arange(3), 4)
    expected = np.concatenate([past.warm_k(state) for state in states])
    np.testing.assert_array_equal(_warm(windows, states, which, over), expected)
    assert len(np.unique(expected)) == 5, "cold, and at two moments of two models"
