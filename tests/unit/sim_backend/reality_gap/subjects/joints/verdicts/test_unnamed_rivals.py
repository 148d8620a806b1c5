"""Laws without a name in the catalogue keep causes from being named that look like them."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.knowledge.unnamed_laws import DRAG
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import with_controllers
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import select_by_rollouts
from sim_backend.reality_gap.subjects.joints.verdicts.unnamed_rivals import _as_lossy, against_unnamed
from sim_backend.reality_gap.verdict import Verdict, VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints import pendulum

PENDULUM = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody>
 <body name="arm"><joint name="hinge" axis="0 1 0" armature="0.001"/>
  <inertial pos="0 0 -0.2" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body>
</worldbody></mujoco>
"""
WHEEL = PENDULUM.replace('pos="0 0 -0.2"', 'pos="0 0 0"').replace('armature="0.001"', 'armature="0.02" frictionloss="{loss}"')
ARM = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody><body>
 <joint name="upper" axis="0 1 0" damping="0.05" frictionloss="0.08" armature="0.01"/>
 <inertial pos="0 0 -0.15" mass="1" diaginertia="0.0075 0.0075 0.001"/>
 <body pos="0 0 -0.3"><joint name="lower" axis="0 1 0" damping="0.03" frictionloss="0.04" armature="0.005"/>
  <inertial pos="0 0 -{centre}" mass="{mass}" diaginertia="0.006 0.006 0.001"/></body></body></worldbody></mujoco>
"""
STEP_S, DRAG_NM_S2 = 0.005, 0.004


def swung(begin_rad: float, seed: int) -> Recording:
    """A pendulum that nothing drives swings through air, whose drag grows with the square of speed."""
    model, rng = mujoco.MjModel.from_xml_string(PENDULUM), np.random.default_rng(seed)
    data, found = mujoco.MjData(model), np.empty((1200, 1))
    data.qpos[0] = begin_rad
    for row in found:
        row[0] = data.qpos[0] + 5e-5 * rng.standard_normal()
        for _ in range(10):
            data.qfrc_applied[0] = -DRAG_NM_S2 * data.qvel[0] * abs(data.qvel[0])
            mujoco.mj_step(model, data)
    joints = JointSignals(("hinge",), found, commanded_torque_nm=np.zeros_like(found))
    return Recording(f"from {begin_rad}", "made here", STEP_S, STEP_S * np.arange(len(found)), joints)


def beside_drag(only: str | None = None) -> tuple[Verdict, Verdict]:
    """Of a pendulum that drag slows down: by all effects or one, and beside unnamed laws."""
    model, robot = mujoco.MjModel.from_xml_string(PENDULUM), UnknownRobot(Tolerance())
    study = study_joints(model, [swung(1.6, 1), swung(-1.1, 2)], lambda *_: None, robot=robot, gate=np.inf)
    catalogue = study.fit.first.catalogue
    if only is not None:
        catalogue = replace(catalogue, hypotheses=tuple(h for h in catalogue.hypotheses if h.effect == only))
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, catalogue, lambda _: True)
    before = pendulum.judged(study, selection, DrawnRobots(problem, np.random.default_rng(0), draws=20))
    return before, against_unnamed(before, selection, FAR_OFF * problem.noise_rad)


def test_drag_of_the_air_is_not_called_viscous_friction():
    before, found = beside_drag()
    assert {cause.effect for cause in before.causes} <= {"viscous_friction", "coulomb_friction", "load_friction"}
    assert found.verdict is VerdictKind.UNEXPLAINED and "square of speed" in found.summary


def test_what_no_effect_explains_is_told_with_the_law_that_takes_half_of_it():
    before, found = beside_drag(only="torque_saturation")
    assert before.verdict is found.verdict is VerdictKind.UNEXPLAINED and "square of speed" not in before.summary
    assert "With drag that grows with the square of speed half of what is left goes" in found.summary
    assert found.record_next[0] == "each joint slowly and as fast as it goes"


def turned(both_ways: bool, seed: int) -> Recording:
    """A wheel with dry friction that a torque turns one way, or both."""
    model, rng = mujoco.MjModel.from_xml_string(WHEEL.format(loss=0.05)), np.random.default_rng(seed)
    data, found, sent = mujoco.MjData(model), np.empty((1200, 1)), np.empty((1200, 1))
    phase = rng.uniform(0.0, 2.0 * np.pi, 2)
    for i, row in enumerate(found):
        row[0] = data.qpos[0] + 5e-5 * rng.standard_normal()
        waves = 0.08 * np.sin(1.9 * STEP_S * i + phase[0]) + 0.05 * np.sin(4.3 * STEP_S * i + phase[1])
        sent[i] = 2.0 * waves if both_ways else 0.2 + waves - 0.03 * data.qvel[0]
        for _ in range(10):
            data.qfrc_applied[0] = sent[i, 0]
            mujoco.mj_step(model, data)
    return Recording(
        f"r{seed}", "made here", STEP_S, STEP_S * np.arange(1200), JointSignals(("hinge",), found, commanded_torque_nm=sent)
    )


@pytest.mark.parametrize("both_ways", [True, False])
def test_friction_of_a_joint_that_turns_one_way_alone_may_be_a_torque_that_is_always_there(both_ways):
    model, robot = mujoco.MjModel.from_xml_string(WHEEL.format(loss=0.0)), UnknownRobot(Tolerance())
    study = study_joints(model, [turned(both_ways, 1), turned(both_ways, 2)], lambda *_: None, robot=robot, gate=np.inf)
    problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, problem.catalogue, lambda _: True)
    before = pendulum.judged(study, selection, DrawnRobots(problem, np.random.default_rng(0), draws=20))
    found = against_unnamed(before, selection, FAR_OFF * problem.noise_rad)
    said = any("always there" in one for one in found.cannot_tell)
    assert {cause.effect for cause in before.causes} >= {"coulomb_friction"} if both_ways else before.causes
    assert (found.verdict is VerdictKind.NAMED) is both_ways and said is not both_ways


def arm(mass_kg: float, centre_m: float) -> mujoco.MjModel:
    """Two links, the lower one with such a mass and centre."""
    return mujoco.MjModel.from_xml_string(ARM.format(mass=mass_kg, centre=centre_m))


def followed(model: mujoco.MjModel, quickness: float, seed: int) -> Recording:
    """An arm that a controller leads along sines, so much quicker or slower than 1 to 9 rad/s."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    found, sent = np.empty((2400, 2)), np.empty((2400, 2))
    speed, phase = quickness * rng.uniform(1.0, 9.0, (2, 3)), rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    for i in range(len(found)):
        found[i] = data.qpos
        target = np.array([0.4, 0.5]) * np.sin(speed * STEP_S * i + phase).sum(axis=1)
        sent[i] = np.array([20.0, 10.0]) * (target - data.qpos) - np.array([1.0, 0.4]) * data.qvel
        data.qfrc_applied[:] = sent[i]
        for _ in range(10):
            mujoco.mj_step(model, data)
    joints = JointSignals(("upper", "lower"), found + 1e-4 * rng.standard_normal(found.shape), commanded_torque_nm=sent)
    return Recording(f"r{seed}", "made here", STEP_S, STEP_S * np.arange(len(found)), joints)


@pytest.mark.parametrize(
    ("mass_kg", "centre_m", "quickness", "is_mass"),
    [(0.8, 0.162, 0.15, False), (0.88, 0.15, 1.0, True)],
    ids=["a centre that slow motions cannot tell from masses", "a mass that quick motions tell"],
)
def test_a_centre_of_mass_that_is_off_is_not_called_masses(mass_kg, centre_m, quickness, is_mass):
    robot = UnknownRobot(Tolerance())
    recordings = [followed(arm(mass_kg, centre_m), quickness, seed) for seed in (1, 2)]
    study = study_joints(arm(0.8, 0.15), recordings, lambda *_: None, robot=robot, gate=np.inf)
    hypotheses = tuple(h for h in study.fit.first.catalogue.hypotheses if h.effect == "link_mass")
    problem = RolloutProblem(
        study.problem.episodes, study.start, replace(study.fit.first.catalogue, hypotheses=hypotheses), robot.tolerance
    )
    selection = select_by_rollouts(problem, problem.catalogue, lambda _: True)
    before = pendulum.judged(study, selection, DrawnRobots(problem, np.random.default_rng(0), draws=20))
    found = against_unnamed(before, selection, FAR_OFF * problem.noise_rad)
    assert before.verdict is VerdictKind.NAMED
    assert (found.verdict is VerdictKind.NAMED) is is_mass
    assert any("centre of mass" in said for said in (found.summary, *found.cannot_tell)) is not is_mass


def test_drag_is_tried_where_it_takes_as_much_energy_as_the_friction():
    speed = np.array([[1.0, 0.1], [-3.0, 0.2]])
    friction, drag = Term("viscous_friction.damping_nm_s_rad", 0, 1e-3), Term(DRAG, 0, 1e-3)
    problem = SimpleNamespace(windows=SimpleNamespace(begin_rad_s=speed), start=JointState(2))
    selection = SimpleNamespace(problem=problem, fit=SimpleNamespace(state=JointState(2).with_values({(friction.key, 0): 0.7})))
    values = _as_lossy(selection, SimpleNamespace(terms=(friction,)), [drag])
    assert values is not None
    lost = values[DRAG, 0] * np.abs(speed[:, 0]) ** 3
    assert lost.mean() == pytest.approx(0.7 * (speed[:, 0] ** 2).mean())
    other = Term("coulomb_friction.torque_nm", 0, 1e-3)
    assert _as_lossy(selection, SimpleNamespace(terms=(other,)), [drag]) is None


def beside_unnamed(braking: float, hidden: str = "", of_gain: float = 1.0) -> tuple[Verdict, Verdict]:
    """Of a servo said to be braked by its own voltage so many times as it is: by effects alone, and beside unnamed laws."""
    nominal, model = (mujoco.MjModel.from_xml_string(pendulum.PENDULUM.format(more=more)) for more in ("", hidden))
    recordings = []
    for seed in (1, 2):
        target_rad = pendulum.targets(6.0, seed)
        went = pendulum.recorded(model, target_rad, seed=seed, on_board=True, of_gain=of_gain)
        one = pendulum.only_targets(went, target_rad, on_board=True)
        joints = one.joints
        assert joints is not None and joints.feedback is not None and joints.velocity_rad_s is not None
        none = np.zeros_like(joints.position_rad)
        said = replace(joints.feedback, damping_nm_s_rad=none, back_emf_nm_s_rad=none + braking * pendulum.DAMPING)
        believed_nm = said.torque_nm(joints.position_rad, joints.velocity_rad_s)
        recordings.append(replace(one, name=f"{seed}", joints=replace(joints, commanded_torque_nm=believed_nm, feedback=said)))
    robot = UnknownRobot(Tolerance())
    study = study_joints(nominal, recordings, lambda *_: None, robot=robot, gate=np.inf)
    catalogue = with_controllers(study.fit.first.catalogue, ("hinge",), np.array([True]))
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, catalogue, lambda _: True)
    before = pendulum.judged(study, selection, DrawnRobots(problem, np.random.default_rng(0)))
    return before, against_unnamed(before, selection, FAR_OFF * problem.noise_rad)


def test_a_servo_s_motor_that_brakes_less_than_is_said_is_not_called_gain_or_torque_constant():
    before, found = beside_unnamed(2.5)
    assert before.verdict is VerdictKind.NAMED and {c.effect for c in before.causes} == {"position_gain", "torque_constant"}
    assert found.verdict is VerdictKind.CONFUSABLE and "own voltage brakes it" in found.summary
    assert any("without load" in advice for advice in found.record_next)


def test_friction_of_a_servo_s_joint_is_not_told_from_its_motor_s_braking():
    _, found = beside_unnamed(1.0, hidden='damping="0.05"')
    assert found.verdict is VerdictKind.CONFUSABLE and [c.effect for c in found.causes] == ["viscous_friction"]


def test_a_servo_s_gain_is_named_beside_its_motor_s_braking():
    _, found = beside_unnamed(1.0, of_gain=1.3)
    assert found.verdict is VerdictKind.NAMED and [c.effect for c in found.causes] == ["position_gain"]
