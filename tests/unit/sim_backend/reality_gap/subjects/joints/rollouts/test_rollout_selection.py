"""What is hidden in a known pendulum is found by where it goes, and nothing where nothing is hidden."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.reality_gap.knowledge.joint_effects import FITTED
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.model.native_elements import add_play
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Hypothesis, with_controllers
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts import rollout_fit, rollout_search, rollout_selection
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import would_move_nats
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE, CauseSearch, Taken, _least, may_be
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, select_by_rollouts
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_causes import least_of
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_rivals import is_ahead
from sim_backend.reality_gap.verdict import Told, VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import (
    COGGING_NM,
    COGS,
    LIMIT_NM,
    LOSS_NM2,
    PENDULUM,
    STICKS_RAD_S,
    WARMS_S,
    judged,
    only_targets,
    problem_of,
    recorded,
    study_of,
    targets,
)

PLAY_RAD = 0.03
RUBS_NM = 0.1


@pytest.fixture(scope="module")
def rubbing():
    """The verdict on a pendulum whose bearing rubs."""
    return study_of(f'frictionloss="{RUBS_NM}"')


def is_named_alone(verdict, effect: str, value: float) -> bool:
    """Whether an effect is the only cause, at the hinge, with its value, which its interval holds."""
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert (cause.effect, cause.where) == (effect, "hinge")
    assert cause.interval_90[0] < value < cause.interval_90[1] and cause.value == pytest.approx(value, rel=0.1)
    return [e.told for e in verdict.effects if e.effect == effect] == [Told.NAMED]


def test_a_hidden_loss_is_named_by_where_the_pendulum_goes(rubbing):
    assert is_named_alone(rubbing, "coulomb_friction", RUBS_NM)


@pytest.mark.scale
def test_a_loss_that_is_a_straight_line_is_named_by_where_the_pendulum_goes():
    """`test_a_hidden_loss_is_named_by_where_the_pendulum_goes` has the loss that is no straight line."""
    assert is_named_alone(study_of('damping="0.03"'), "viscous_friction", 0.03)


def test_how_a_soft_friction_sets_in_is_no_second_cause(rubbing):
    assert [cause.effect for cause in rubbing.causes] == ["coulomb_friction"]
    assert rubbing.causes[0].value == pytest.approx(RUBS_NM, rel=0.02)


def test_a_load_in_one_of_two_recordings_is_no_cause_of_the_robot():
    loaded = mujoco.MjModel.from_xml_string(PENDULUM.format(more="").replace('mass="0.6"', 'mass="1.2"'))
    verdict = study_of("", seconds=15.0, then=loaded)
    assert verdict.verdict is VerdictKind.UNEXPLAINED, verdict.summary
    assert "what is another in swing 2, such as a load or the rig: in swing 1 the model goes" in verdict.cannot_tell[0]


def test_friction_that_falls_off_in_another_way_is_told_with_its_exponent():
    verdict = study_of("", sticking_nm=0.1)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    told = {cause.parameter: cause for cause in verdict.causes}
    assert {cause.effect for cause in verdict.causes} == {"stribeck_friction"}
    assert told["exponent"].value == 1.0
    for parameter, value in (("extra_nm", 0.1), ("speed_rad_s", STICKS_RAD_S)):
        low, high = told[parameter].interval_90
        assert low < value < high, f"{parameter}: {told[parameter]}"


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


def test_the_model_without_causes_is_the_one_that_gains_no_more(monkeypatch):
    problem, further = problem_of(), []
    monkeypatch.setattr(rollout_selection, "settled", lambda of, fit: further.append(replace(fit)) or further[-1])
    found = select_by_rollouts(problem, problem.catalogue.without(list(FITTED)), lambda _: True)
    assert found.nominal is further[0] and found.nominal.causes == 0


def test_a_motor_with_less_torque_beside_friction_is_told_with_a_heavier_link():
    """Torque over inertia and weight is all that motion shows."""
    verdict = study_of('frictionloss="0.08"', lost=0.2)
    assert verdict.verdict is VerdictKind.CONFUSABLE, verdict.summary
    value = {cause.effect: cause.value for cause in verdict.causes}
    assert set(value) == {"torque_constant", "link_mass", "coulomb_friction"}
    assert value["torque_constant"] == pytest.approx(-0.2, abs=0.03)
    assert value["link_mass"] == pytest.approx(1.25, abs=0.05)


def test_of_few_windows_a_model_is_ahead_only_where_they_agree():
    problem = SimpleNamespace(windows=range(5), gained_by_window=lambda before, after: np.log(before / after).sum(axis=1))
    fit = SimpleNamespace(squares=np.ones((5, 1)))
    by_all, by_one = (SimpleNamespace(squares=np.exp(np.array(nats))[:, None]) for nats in ([4, 5, 3, 4, 6], [22, 0, 1, -1, 0]))
    assert is_ahead(problem, fit, by_all) and not is_ahead(problem, fit, by_one)
    problem.windows = range(LEAST_WINDOWS)
    assert is_ahead(problem, fit, by_one), "of many the nats are asked"


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
    assert "loss_per_k and rise_k_nm2 of hinge apart: motions show only their product" in verdict.cannot_tell


def test_a_motor_that_cogs_as_often_as_no_other_is_named_with_how_often():
    verdict = study_of("", seconds=16.0, cogging_nm=COGGING_NM)
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    value = {cause.parameter: cause.value for cause in verdict.causes}
    assert {cause.effect for cause in verdict.causes} == {"cogging"}
    assert value["amplitude_nm"] == pytest.approx(COGGING_NM, rel=0.15)
    assert value["cycles_per_rad"] == pytest.approx(COGS / (2.0 * np.pi))


def test_play_between_an_encoder_and_its_joint_is_named():
    spec = mujoco.MjSpec.from_string(PENDULUM.format(more=""))
    assert add_play(spec.joint("hinge"), PLAY_RAD, 1e-3) is None
    verdict = study_of(spec.compile(), seconds=8.0)
    (cause,) = verdict.causes
    assert (cause.effect, cause.where) == ("backlash", "hinge"), verdict.summary
    assert cause.value == pytest.approx(PLAY_RAD, rel=0.15), "its sides give way a little"


def test_of_three_causes_those_that_gain_little_are_causes_too_where_all_together_leave_nothing():
    verdict = study_of('frictionloss="0.15" damping="0.02"', late_rows=2)
    assert {cause.effect for cause in verdict.causes} == {"coulomb_friction", "viscous_friction", "action_delay"}, verdict.summary


@pytest.mark.parametrize(
    ("healthy_rad", "effects"), [(1.5e-3, {"coulomb_friction"}), (3e-3, {"coulomb_friction", "viscous_friction"})]
)
def test_a_cause_that_gains_little_is_one_where_only_with_it_no_more_is_left_than_healthy_robots_leave(
    monkeypatch, healthy_rad, effects
):
    """With both 1.8 mrad are left, with dry friction alone 8.8."""
    monkeypatch.setattr(rollout_selection, "_leaves_nothing", lambda *_: False)
    problem = problem_of(hidden='frictionloss="0.15" damping="0.008"')
    found = select_by_rollouts(problem, problem.catalogue, lambda _: True, healthy_rad=healthy_rad)
    assert {cause.hypothesis.effect for cause in found.taken} == effects
    assert {cause.hypothesis.effect for cause in found.mending} == {"coulomb_friction", "viscous_friction"} - effects


@pytest.mark.parametrize(("gravity_m_s2", "friction_nm"), [pytest.param(7.0, 0.08, marks=pytest.mark.scale), (12.5, 0.1)])
def test_gravity_beside_friction_is_named_where_no_straight_line_leads_to_it(gravity_m_s2, friction_nm):
    """A spring about the middle of the swing had been named instead, or a lighter link with a larger rotor.

    `test_gravity_beside_friction_is_named_where_no_straight_line_leads_to_it` has one that is stronger without scale.
    """
    verdict = study_of(f'frictionloss="{friction_nm}"', gravity_m_s2=gravity_m_s2)
    value = {(cause.effect, cause.where): cause.value for cause in verdict.causes}
    assert {effect for effect, _ in value} == {"gravity", "coulomb_friction"}, verdict.summary
    assert value["gravity", "z"] == pytest.approx(9.81 - gravity_m_s2, rel=0.1)
    assert value["coulomb_friction", "hinge"] == pytest.approx(friction_nm, rel=0.02)


def test_where_a_straight_line_leads_astray_a_fit_begins_from_what_torques_found(monkeypatch):
    problem, limits = problem_of(LIMIT_NM), "torque_saturation"
    own = rollout_search.gains

    def astray(*asked):
        """Limits far above all that was sent, from where nothing leads back."""
        return [(gain, h, 0.0 * values if h.effect == limits else values, e) for gain, h, values, e in own(*asked)]

    monkeypatch.setattr(rollout_search, "gains", astray)
    without_levels = {key: replace(number, begins_at_load=False) for key, number in rollout_search.NUMBERS.items()}
    monkeypatch.setattr(rollout_search, "NUMBERS", without_levels)
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
    search = CauseSearch(problem, problem.catalogue, lambda _: True, lambda *_: None, {}, 0.0)
    assert not may_be(search, weaker, ()) and may_be(search, weaker, (), is_whole=False)
    assert may_be(replace(search, healthy_rad=1.01 * weaker.usual_rad), weaker, ())
    assert not may_be(replace(search, healthy_rad=0.99 * weaker.usual_rad), weaker, ())


def test_windows_of_which_one_in_five_is_far_off_are_not_near_noise():
    problem = problem_of()
    fit = problem.begun(problem.start)
    squares = np.resize(fit.squares, (100, 1))
    few, many = (np.where(np.arange(100)[:, None] % of == 0, 1.0, squares) for of in (20, 5))
    assert problem.is_near_noise(fit) and problem.is_near_noise(replace(fit, squares=few))
    assert not problem.is_near_noise(replace(fit, squares=many))


def verdict_where_only_targets_are_known(*, on_board: bool = False, **of_controller: float):
    """Of two recordings of a pendulum, without torques; the controller is said to be as usual."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recordings = []
    for seed in (1, 2):
        target = targets(6.0, seed)
        went = recorded(model, target, seed=seed, on_board=on_board, **of_controller)  # pyrefly: ignore[bad-argument-type]
        recordings.append(replace(only_targets(went, target, on_board=on_board), name=f"{seed}"))
    robot = UnknownRobot(Tolerance())
    study = study_joints(model, recordings, lambda *_: None, robot=robot, gate=np.inf)
    catalogue = with_controllers(study.fit.first.catalogue, ("hinge",), np.array([True]))
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, catalogue, lambda _: True)
    return judged(study, selection, DrawnRobots(problem, np.random.default_rng(0))), selection, study


def test_a_servo_s_targets_are_late_and_its_own_loop_is_not():
    verdict, selection, study = verdict_where_only_targets_are_known(on_board=True, targets_late_rows=6)
    assert verdict.verdict is VerdictKind.NAMED
    assert [(cause.effect, cause.where) for cause in verdict.causes] == [("action_delay", "hinge")], verdict.summary
    assert verdict.causes[0].value == pytest.approx(0.03, rel=0.1)
    with_it, without = (  # torques along the motion are made of the same late targets
        np.concatenate([e.torque_error(state)[e.valid_mechanics[:, 0], 0] for e in study.problem.episodes])
        for state in (selection.fit.state, selection.problem.start)
    )
    assert np.std(with_it) < 0.5 * np.std(without)


@pytest.mark.parametrize("of_gain", [0.75, 1.0])
def test_a_controller_with_less_gain_is_named_where_only_targets_are_known(of_gain):
    verdict, selection, _ = verdict_where_only_targets_are_known(of_gain=of_gain)
    if of_gain == 1.0:
        assert verdict.verdict is VerdictKind.NOTHING_WRONG, verdict.summary
        (excluded,) = [each.above for each in verdict.effects if each.effect == "position_gain"]
        assert excluded is not None and 0.0 < excluded < 0.1
        return
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert cause.effect == "position_gain" and cause.value == pytest.approx(of_gain, abs=0.02)
    assert would_move_nats(selection.problem, selection.fit) < 1.0
    halfway = selection.problem.begun(
        selection.problem.start.moved(Term("position_gain.factor", 0, 0.003), -0.1, with_shape=False)
    )
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

    def selected(search, *_):
        problem = search.problem
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


@pytest.mark.parametrize(
    ("joint", "usual_rad", "where", "explains"),
    [
        (1, (9e-3, 1e-3), "elbow", True),
        (1, (9e-3, 4e-3), "elbow", False),
        (0, (1e-3, 9e-3), "shoulder", False),
        (1, (9e-3, 1e-3), "all joints", False),
    ],
    ids=["most of its joint's", "half of it", "where another is", "everywhere"],
)
def test_a_small_gain_counts_where_it_is_most_of_a_joint_s_error_and_no_other_cause_is(joint, usual_rad, where, explains):
    friction, slack = (Term(key, at, 1e-3) for key, at in (("coulomb_friction.torque_nm", 0), ("backlash.gap_rad", joint)))
    problem = SimpleNamespace(noise_rad=np.full(2, 1e-4), is_near_noise=lambda _: False)
    before, after = SimpleNamespace(usual_rad=np.full(2, 9e-3)), SimpleNamespace(usual_rad=np.array(usual_rad))
    taken = [Taken(Hypothesis("coulomb_friction", "shoulder", (0,), (1.0,)), (friction,), 1000.0, ())]
    least = _least(problem, before, (100.0, after, Hypothesis("backlash", where, (1,), (1.0,)), (slack,)), taken, 0.5)
    assert least == (GATE if explains else 500.0)


def test_a_joint_with_less_of_a_cause_than_a_trifle_has_it_where_its_model_cannot_be_so_far_off():
    damping = "viscous_friction.damping_nm_s_rad"
    start = JointState(2, {damping: np.array([0.0, 0.05])})
    study = SimpleNamespace(robot=UnknownRobot(Tolerance(friction=0.1)), start=start)
    assert least_of(study, damping, 0, 1.0) == pytest.approx(0.05), "no friction of its own to be off by"
    assert least_of(study, damping, 1, 1.0) == pytest.approx(0.1 * 0.05)
    assert least_of(study, "backlash.gap_rad", 1, 1.0) == pytest.approx(0.05)


@pytest.mark.parametrize(("hidden", "effect"), [("heavier", "link_mass"), ('frictionloss="0.08"', "coulomb_friction")])
def test_a_mass_is_compared_with_a_gravity_of_another_strength_however_little_it_leaves(monkeypatch, hidden, effect):
    """They look alike; friction does not, and leaves as little here."""
    asked = []
    monkeypatch.setattr(rollout_selection, "_with_other_gravity", lambda *_: asked.append(True))
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more="" if hidden == "heavier" else hidden))
    if hidden == "heavier":
        model.body_mass[1:] *= 1.2
        model.body_inertia[1:] *= 1.2
    nominal = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    recordings = [replace(recorded(model, targets(6.0, seed), seed=seed), name=f"{seed}") for seed in (1, 2)]
    robot = UnknownRobot(Tolerance())
    study = study_joints(nominal, recordings, lambda *_: None, robot=robot, gate=np.inf)
    catalogue = study.fit.first.catalogue
    own = replace(catalogue, hypotheses=tuple(h for h in catalogue.hypotheses if h.effect == effect))
    problem = RolloutProblem(study.problem.episodes, study.start, own, robot.tolerance)
    found = select_by_rollouts(problem, own, lambda _: True, healthy_rad=0.01)
    assert [cause.hypothesis.effect for cause in found.taken] == [effect]
    assert bool(asked) == (effect == "link_mass")
