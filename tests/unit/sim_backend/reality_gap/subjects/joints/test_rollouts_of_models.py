"""Windows of a known pendulum: simulated as MuJoCo alone does, and what was hidden in it is found by where it goes."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints import rollout_fit, rollout_selection
from sim_backend.reality_gap.subjects.joints.forward import Forward, Windows
from sim_backend.reality_gap.subjects.joints.healthy_robots import Healthy, draw_healthy
from sim_backend.reality_gap.subjects.joints.hypotheses import Hypothesis, with_controllers
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.plant import Plant
from sim_backend.reality_gap.subjects.joints.recorded_windows import windows_of
from sim_backend.reality_gap.subjects.joints.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollout_questions import would_move_nats
from sim_backend.reality_gap.subjects.joints.rollout_selection import (
    GATE,
    RolloutSelection,
    Taken,
    _may_be,
    _Search,
    select_by_rollouts,
)
from sim_backend.reality_gap.subjects.joints.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.verdict_of_rollouts import verdict_of_rollouts
from sim_backend.reality_gap.verdict import Told, VerdictKind

PENDULUM = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody>
 <body name="arm"><joint name="hinge" type="hinge" axis="0 1 0" armature="0.001" {more}/>
  <inertial pos="0 0 -0.15" mass="0.6" diaginertia="1e-3 1e-3 1e-3"/></body>
</worldbody><actuator><motor joint="hinge"/></actuator></mujoco>
"""
STEP_S = 0.005
GAIN, DAMPING = 3.0, 0.1
LIMIT_NM = 0.8
LOSS_NM2, WARMS_S = 0.5, 4.0
COGS, COGGING_NM = 42, 0.05
NO_LIMIT = {"torque_saturation.limit_nm": np.array([1e9])}


def recorded(
    model: mujoco.MjModel,
    target_rad: np.ndarray,
    *,
    seed: int = 0,
    noise_rad: float = 1e-4,
    of_gain: float = 1.0,
    limit_nm: float = np.inf,
    loss_nm2: float = 0.0,
    late_rows: int = 0,
    cogging_nm: float = 0.0,
) -> Recording:
    """A PD controller follows targets at 200 Hz; positions have noise, which the controller sees.

    Its motor has a limit, gets warm within ``WARMS_S`` and loses then, acts some rows late, and cogs ``COGS`` times a turn.
    """
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    found, warm, sent = np.empty((3, len(target_rad))), 0.0, [0.0] * late_rows
    for i, target in enumerate(target_rad):
        position = data.qpos[0] + noise_rad * rng.standard_normal()
        sent_nm = of_gain * GAIN * (target - position) - DAMPING * data.qvel[0]
        found[:, i] = position, data.qvel[0], sent_nm
        sent.append(np.clip(sent_nm, -limit_nm, limit_nm))
        warm += STEP_S / WARMS_S * (sent[i] ** 2 - warm)
        data.ctrl[0] = sent[i] * (1.0 - loss_nm2 * warm) + cogging_nm * np.sin(COGS * data.qpos[0] + 0.4)
        for _ in range(round(STEP_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
    position, velocity, torque = (row[:, None] for row in found)
    joints = JointSignals(("hinge",), position, velocity, commanded_torque_nm=torque)
    return Recording("swing", "made here", STEP_S, STEP_S * np.arange(len(target_rad)), joints)


def targets(seconds: float, seed: int) -> np.ndarray:
    """Sums of slow and fast sines."""
    time_s, rng = np.arange(0.0, seconds, STEP_S), np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, 4)
    return sum(0.4 * np.sin(2.0 * np.pi * f * time_s + phase) for f, phase in zip((0.2, 0.5, 0.9, 1.7), phases, strict=True))


def one_window(position: np.ndarray, sent: np.ndarray, feedback: Feedback | None = None) -> Windows:
    begin = np.zeros((1, 1))
    return Windows(STEP_S, position, begin, begin, sent, feedback, np.zeros(1, int))


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
    law = [np.full((1, samples, 1), value) for value in (1.0, 5.0, 0.0, stall_nm, 0.02, 0.0)]
    window = one_window(np.zeros((1, samples, 1)), np.full((1, samples, 1), np.nan), Feedback(*law))
    state = JointState(1, {"viscous_friction.damping_nm_s_rad": np.array([0.1]), **NO_LIMIT})
    forward = Forward(Plant(model, ["hinge"]), STEP_S)
    rests = forward.positions(window, window.begin_rad, window.begin_rad_s, [state], np.zeros(1, int))[0, -1, 0]
    asked = min(5.0 * (1.0 - rests), stall_nm)
    assert asked == pytest.approx(0.6 * 9.81 * 0.15 * np.sin(rests), rel=1e-3)


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
    law = [np.full((1, samples, 1), value) for value in (0.3, 6.0, 0.4, np.inf, 0.0, 0.0)]
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


def study_of(
    hidden: str, *, tolerance: Tolerance | None = None, seconds: float = 6.0, gravity_m_s2: float = 9.81, **of_motor: float
):
    """Judge two recordings of a pendulum that has more than its model, and a motor as :func:`recorded` has it."""
    nominal = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=hidden))
    model.opt.gravity[2] = -gravity_m_s2
    recordings = [
        replace(recorded(model, targets(seconds, seed), seed=seed, **of_motor), name=f"swing {seed}") for seed in (1, 2)
    ]
    robot = UnknownRobot(tolerance or Tolerance())
    study = study_joints(nominal, recordings, lambda *_: None, robot=robot, gate=np.inf)
    problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, study.fit.first.catalogue, lambda _: True)
    return verdict_of_rollouts(study, selection, draw_healthy(problem, np.random.default_rng(0)))


@pytest.mark.parametrize(
    ("hidden", "effect", "value"),
    [
        ('frictionloss="0.08"', "coulomb_friction", 0.08),
        pytest.param('damping="0.03"', "viscous_friction", 0.03, marks=pytest.mark.scale),
    ],
)
def test_a_hidden_loss_is_named_by_where_the_pendulum_goes(hidden, effect, value):
    """`test_a_hidden_loss_is_named_by_where_the_pendulum_goes` has the loss that is no straight line without scale."""
    verdict = study_of(hidden)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert (cause.effect, cause.where) == (effect, "hinge")
    assert cause.interval_90[0] < value < cause.interval_90[1] and cause.value == pytest.approx(value, rel=0.1)
    assert [e.told for e in verdict.effects if e.effect == effect] == [Told.NAMED]


def test_a_fit_that_has_settled_probes_only_causes_and_ends_in_the_same_place(monkeypatch):
    nominal = mujoco.MjModel.from_xml_string(PENDULUM.format(more='damping="0.01"'))
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='damping="0.0102" frictionloss="0.08"'))
    study = study_joints(nominal, [recorded(model, targets(6.0, 1))], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
    problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, Tolerance())
    friction, simulated = Term("coulomb_friction.torque_nm", 0, 5e-4), []
    positions = problem.forward.positions
    monkeypatch.setattr(problem.forward, "positions", lambda w, b, *rest: simulated.append(len(b)) or positions(w, b, *rest))

    def fitted(settles: float):
        monkeypatch.setattr(rollout_fit, "_SETTLES", settles)
        simulated.clear()
        return problem.fitted(study.start, [friction]), sum(simulated)

    own = rollout_fit._SETTLES
    (always, most), (settled, fewer) = fitted(0.0), fitted(own)
    assert fewer < 0.8 * most
    values = [fit.state.value(friction.key)[0] for fit in (always, settled)]
    assert values[1] == pytest.approx(values[0], rel=0.02), "its own interval is 10 % wide"
    assert np.median(settled.squares) == pytest.approx(np.median(always.squares), rel=0.1)


def test_a_limit_that_few_windows_meet_is_named_and_not_called_healthy():
    """Most windows are as right as can be, some end up far off."""
    verdict = study_of("", limit_nm=LIMIT_NM)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert cause.effect == "torque_saturation" and cause.value == pytest.approx(LIMIT_NM, rel=0.02)


def test_a_motor_that_gets_warm_is_named_with_how_fast():
    """Windows of a second begin as warm as the motor was."""
    verdict = study_of("", seconds=16.0, loss_nm2=LOSS_NM2)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    value = {cause.parameter: cause.value for cause in verdict.causes if cause.effect == "thermal_derating"}
    assert {cause.effect for cause in verdict.causes} == {"thermal_derating"}
    assert value["time_constant_s"] == pytest.approx(WARMS_S, rel=0.2)
    assert value["loss_per_k"] * value.get("rise_k_nm2", 2000.0) == pytest.approx(LOSS_NM2, rel=0.1)


def test_a_motor_that_cogs_as_often_as_no_other_is_named_with_how_often():
    verdict = study_of("", seconds=16.0, cogging_nm=COGGING_NM)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    value = {cause.parameter: cause.value for cause in verdict.causes}
    assert {cause.effect for cause in verdict.causes} == {"cogging"}
    assert value["amplitude_nm"] == pytest.approx(COGGING_NM, rel=0.15)
    assert value["cycles_per_rad"] == pytest.approx(COGS / (2.0 * np.pi))


def test_of_three_causes_those_that_gain_little_are_causes_too_where_all_together_leave_nothing():
    verdict = study_of('frictionloss="0.15" damping="0.02"', late_rows=2)
    assert {cause.effect for cause in verdict.causes} == {"coulomb_friction", "viscous_friction", "action_delay"}, verdict.summary


def problem_of(limit_nm: float = np.inf) -> RolloutProblem:
    """Windows of a pendulum whose motor ends somewhere."""
    model, robot = mujoco.MjModel.from_xml_string(PENDULUM.format(more="")), UnknownRobot(Tolerance())
    recordings = [replace(recorded(model, targets(6.0, seed), seed=seed, limit_nm=limit_nm), name=f"{seed}") for seed in (1, 2)]
    study = study_joints(model, recordings, lambda *_: None, robot=robot, gate=np.inf)
    return RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)


def test_where_a_straight_line_leads_astray_a_fit_begins_from_what_torques_found(monkeypatch):
    problem, limits = problem_of(LIMIT_NM), "torque_saturation"
    own = rollout_selection.gains

    def astray(*asked):
        """Limits far above all that was sent, from where nothing leads back."""
        return [(gain, h, 0.0 * values if h.effect == limits else values, e) for gain, h, values, e in own(*asked)]

    monkeypatch.setattr(rollout_selection, "gains", astray)
    found = [
        [
            cause.hypothesis.effect
            for cause in select_by_rollouts(problem, problem.catalogue, lambda _: True, proposed=given).taken
        ]
        for given in ({}, {(limits, "hinge"): {("torque_saturation.limit_nm", 0): 1.1 * LIMIT_NM}})
    ]
    assert limits not in found[0] and found[1] == [limits]


def test_gravity_of_another_strength_is_possible_where_no_more_is_left_than_healthy_robots_leave():
    problem = problem_of()
    weaker = problem.begun(problem.start.moved(Term("gravity.offset_m_s2", 2, 1e-3), 2.0, with_shape=False))
    assert not problem.is_near_noise(weaker)
    search = _Search(problem, problem.catalogue, lambda _: True, lambda *_: None, {}, 0.0)
    assert not _may_be(search, weaker, ()) and _may_be(search, weaker, (), is_whole=False)
    assert _may_be(replace(search, healthy_rad=1.01 * weaker.usual_rad), weaker, ())
    assert not _may_be(replace(search, healthy_rad=0.99 * weaker.usual_rad), weaker, ())


def test_windows_of_which_one_in_five_is_far_off_are_not_near_noise():
    problem = problem_of()
    fit = problem.begun(problem.start)
    squares = np.resize(fit.squares, (100, 1))
    few, many = (np.where(np.arange(100)[:, None] % of == 0, 1.0, squares) for of in (20, 5))
    assert problem.is_near_noise(fit) and problem.is_near_noise(replace(fit, squares=few))
    assert not problem.is_near_noise(replace(fit, squares=many))


def only_targets(recording: Recording, target_rad: np.ndarray) -> Recording:
    """The same where nobody recorded a torque, but what the controller is said to be."""
    assert recording.joints is not None
    law = [np.full((len(target_rad), 1), value) for value in (0.0, GAIN, DAMPING, np.inf, 0.0, 0.0)]
    law[0][:, 0] = target_rad
    feedback, joints = Feedback(*law), recording.joints
    assert joints.velocity_rad_s is not None
    believed_nm = feedback.torque_nm(joints.position_rad, joints.velocity_rad_s)
    return replace(recording, joints=replace(joints, commanded_torque_nm=believed_nm, feedback=feedback, not_recorded=("hinge",)))


@pytest.mark.parametrize("of_gain", [0.75, 1.0])
def test_a_controller_with_less_gain_is_named_where_only_targets_are_known(of_gain):
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recordings = [
        replace(only_targets(recorded(model, target := targets(6.0, seed), seed=seed, of_gain=of_gain), target), name=f"{seed}")
        for seed in (1, 2)
    ]
    robot = UnknownRobot(Tolerance())
    study = study_joints(model, recordings, lambda *_: None, robot=robot, gate=np.inf)
    catalogue = with_controllers(study.fit.first.catalogue, ("hinge",), np.array([True]))
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, catalogue, lambda _: True)
    verdict = verdict_of_rollouts(study, selection, draw_healthy(problem, np.random.default_rng(0)))
    if of_gain == 1.0:
        assert verdict.verdict is VerdictKind.NOTHING_WRONG, verdict.summary
        (excluded,) = [each.above for each in verdict.effects if each.effect == "position_gain"]
        assert excluded is not None and 0.0 < excluded < 0.1
        return
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert cause.effect == "position_gain" and cause.value == pytest.approx(of_gain, abs=0.02)
    assert would_move_nats(selection.problem, selection.fit) < 1.0
    halfway = selection.problem.begun(study.start.moved(Term("position_gain.factor", 0, 0.003), -0.1, with_shape=False))
    unsettled = replace(halfway, terms=selection.fit.terms[:1], causes=1, scales=selection.fit.scales[:1])
    assert would_move_nats(selection.problem, unsettled) > GATE, "it would go on to where it fits best"


@pytest.mark.parametrize("is_told_by_the_next", [True, False])
def test_another_way_of_computing_is_tried_with_the_cause_that_came_next(monkeypatch, is_told_by_the_next):
    """What was taken may make up for a controller that holds its torque, so that with it the right way is no nearer."""
    begin = np.zeros((1, 1)), np.zeros((1, 1))

    def fit(off_rad: float) -> RolloutFit:
        return RolloutFit(JointState(1), (), 0, np.zeros(0), np.zeros(0), np.full((4, 1), off_rad**2), begin)

    mass, weak = Term("link_mass.factor", 0, 1e-3), Term("torque_constant.error", 0, 1e-3)
    own, other = Hypothesis("link_mass", "hinge", (0,), (1.0,)), Hypothesis("torque_constant", "hinge", (1,), (1.0,))
    first, held = SimpleNamespace(name="computes all the time"), SimpleNamespace(name="holds its torque")
    first.otherwise = lambda: held
    held.fitted = lambda _, terms, __: fit(1e-4 if is_told_by_the_next and weak in terms else 5e-3)

    def selected(problem, *_):
        taken = Taken(own, (mass,), 99.0, ((90.0, fit(2e-3), other, (weak,)),))
        off_rad = 1e-3 if problem is first else 1e-4
        return RolloutSelection(problem, fit(4e-3), fit(off_rad), (taken,), fit(off_rad))

    monkeypatch.setattr(rollout_selection, "_selected", selected)
    found = select_by_rollouts(first, SimpleNamespace(), lambda _: True)
    assert found.problem is (held if is_told_by_the_next else first)


def test_nothing_is_named_where_nothing_is_hidden_and_every_effect_is_answered_for():
    verdict = study_of("")
    assert verdict.verdict is VerdictKind.NOTHING_WRONG and not verdict.causes, verdict.summary
    assert [each.effect for each in verdict.effects] == list(CATALOGUE)
    for each in verdict.effects:
        assert (each.told is Told.EXCLUDED) == (each.above is not None), each
        assert each.told in {Told.EXCLUDED, Told.NOT_JUDGED} and (each.above or each.because), each
    excluded = {each.effect: each.above for each in verdict.effects if each.told is Told.EXCLUDED}
    assert 0.0 < excluded["coulomb_friction"] < 0.08, "the friction that the test beside this one finds would have been seen"


def test_healthy_robots_are_further_off_where_more_is_tolerated():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='frictionloss="0.08"'))
    study = study_joints(model, [recorded(model, targets(8.0, 3))], lambda *_: None, robot=UnknownRobot(), gate=np.inf)

    def off(friction: float) -> float:
        tolerance = Tolerance(mass=1e-4, inertia=1e-4, centre=1e-4, friction=friction, zero=0.0)
        problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, tolerance)
        return float(draw_healthy(problem, np.random.default_rng(1)).as_it_is_rad[0])

    little, much = off(0.02), off(0.08)
    assert much == pytest.approx(4.0 * little, rel=0.2)


def test_a_fitted_model_is_nearer_to_a_healthy_robot_unless_its_torques_are_noisy():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more='frictionloss="0.02"'))
    recording = recorded(model, targets(8.0, 3))
    assert recording.joints is not None

    def healthy(noise_nm: float) -> tuple[RolloutProblem, Healthy]:
        joints = recording.joints
        assert joints is not None and joints.commanded_torque_nm is not None
        felt = joints.commanded_torque_nm + noise_nm * np.random.default_rng(5).standard_normal(joints.commanded_torque_nm.shape)
        measured = replace(recording, joints=replace(joints, commanded_torque_nm=None, measured_torque_nm=felt))
        study = study_joints(model, [measured], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
        problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, Tolerance())
        return problem, draw_healthy(problem, np.random.default_rng(1), 100)

    problem, noisy = healthy(0.05)
    assert problem.torque_noise_nm[0] == pytest.approx(0.05, rel=0.15)
    _, quiet = healthy(0.0)
    assert 2.0 * quiet.fitted_rad[0] < quiet.as_it_is_rad[0]
    assert noisy.fitted_rad[0] > 3.0 * quiet.fitted_rad[0]
    assert noisy.fitted_far_rad[0] > noisy.fitted_rad[0], "nine windows of ten are further off than half of them"


def test_windows_leave_out_what_was_not_measured():
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recording = recorded(model, targets(8.0, 3))
    study = study_joints(model, [recording], lambda *_: None, robot=UnknownRobot(), gate=np.inf)
    whole = windows_of(study.problem.episodes, 1.0, STEP_S)
    assert recording.joints is not None
    gone = recording.joints.position_rad.copy()
    gone[500:520] = np.nan
    broken = replace(recording, joints=replace(recording.joints, position_rad=gone))
    less = windows_of(
        study_joints(model, [broken], lambda *_: None, robot=UnknownRobot(), gate=np.inf).problem.episodes, 1.0, STEP_S
    )
    assert len(whole) == 7 and len(less) == 6
    assert np.isfinite(less.position_rad).all() and np.isfinite(less.sent_nm).all()
