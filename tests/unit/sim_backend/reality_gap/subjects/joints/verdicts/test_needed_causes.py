"""A cause is named only where a robot needs it: what healthy robots leave needs none."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.rollouts.limits import HealthyLimits
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Taken
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.verdicts.needed_causes import _is_needed, with_needed_causes

TWO = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody>
 <body name="upper"><joint name="shoulder" axis="0 1 0" armature="0.002" damping="0.03" frictionloss="{shoulder}"/>
  <inertial pos="0 0 -0.15" mass="0.6" diaginertia="1e-3 1e-3 1e-3"/>
  <body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" armature="0.002" damping="0.03" frictionloss="{elbow}"/>
   <inertial pos="0 0 -0.1" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/></body></body>
</worldbody></mujoco>
"""
STEP_S, SAMPLES = 0.005, 1200
FRICTION_NM = 0.1


def recorded(model: mujoco.MjModel, seed: int) -> Recording:
    """What torques of several sines make of it, seen by encoders with noise."""
    data, rng, time_s = mujoco.MjData(model), np.random.default_rng(seed), STEP_S * np.arange(SAMPLES)
    phases = rng.uniform(0.0, 2.0 * np.pi, (4, 2))
    sent = sum(0.35 * np.sin(2.0 * np.pi * f * time_s[:, None] + p) for f, p in zip((0.3, 0.7, 1.1, 1.9), phases, strict=True))
    found = np.empty((SAMPLES, 2))
    for row, torque in zip(found, sent, strict=True):
        row[:] = data.qpos + 1e-4 * rng.standard_normal(2)
        data.qfrc_applied[:] = torque
        for _ in range(10):
            mujoco.mj_step(model, data)
    joints = JointSignals(("shoulder", "elbow"), found, commanded_torque_nm=sent)
    return Recording(f"{seed}", "made here", STEP_S, time_s, joints)


def selection_of(shoulder: float, elbow: float, *causes: tuple[str, str]) -> RolloutSelection:
    """Of an arm whose model says half as much dry friction; all of the causes were taken, whatever they gained."""
    nominal = mujoco.MjModel.from_xml_string(TWO.format(shoulder=0.5 * FRICTION_NM, elbow=0.5 * FRICTION_NM))
    model = mujoco.MjModel.from_xml_string(TWO.format(shoulder=shoulder, elbow=elbow))
    robot = UnknownRobot(Tolerance())
    study = study_joints(nominal, [recorded(model, seed) for seed in (1, 2)], lambda *_: None, robot=robot, gate=np.inf)
    catalogue = study.fit.first.catalogue
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    hypotheses = [next(h for h in catalogue.hypotheses if h.name == name) for name in causes]
    taken = [Taken(h, tuple(catalogue.terms[i] for i in h.terms), 100.0 - i, ()) for i, h in enumerate(hypotheses)]
    fit = problem.fitted(problem.start, [term for cause in taken for term in cause.terms])
    return RolloutSelection(problem, problem.fitted(problem.start, ()), fit, tuple(taken), fit)


@pytest.fixture(scope="module")
def of_elbow() -> RolloutSelection:
    """Friction is at the elbow alone, and was taken at all joints; a viscous one was taken beside it."""
    return selection_of(0.5 * FRICTION_NM, 1.5 * FRICTION_NM, ("coulomb_friction", ALL_JOINTS), ("viscous_friction", "shoulder"))


def limits(share: float, of: RolloutFit):
    """Some share of what a model leaves, in far windows three times it."""
    usual_rad, far_rad = share * of.usual_rad, 3.0 * share * of.far_rad
    return lambda _: HealthyLimits(usual_rad, far_rad, far_rad, np.ones(2), of.usual_rad)


def test_of_all_joints_the_one_that_needs_it_is_named_and_nothing_beside_it(of_elbow):
    found = with_needed_causes(of_elbow, limits(2.0, of_elbow.fit), lambda _: True)
    assert [cause.hypothesis.name for cause in found.taken] == [("coulomb_friction", "elbow")]
    assert [(term.key, term.index) for term in found.taken[0].terms] == [("coulomb_friction.torque_nm", 1)]
    assert found.fit.state.value("coulomb_friction.torque_nm")[1] == pytest.approx(1.5 * FRICTION_NM, rel=0.05)
    assert [cause.hypothesis.effect for cause in found.mending] == ["viscous_friction"]
    assert found.extended is of_elbow.extended, "what is not named still mends the extended model"


def test_nothing_goes_without_which_a_model_would_contradict_what_was_measured(of_elbow):
    assert with_needed_causes(of_elbow, limits(2.0, of_elbow.fit), lambda _: False) is of_elbow


def test_what_all_joints_need_stays_theirs():
    selection = selection_of(1.5 * FRICTION_NM, 1.5 * FRICTION_NM, ("coulomb_friction", ALL_JOINTS))
    assert with_needed_causes(selection, limits(2.0, selection.fit), lambda _: True) is selection


@pytest.mark.parametrize(("limit", "is_needed"), [(1.2, True), (2.0, False), (0.8, False)])
def test_a_cause_that_halves_nothing_is_needed_where_only_with_it_a_robot_is_as_healthy_ones_are(of_elbow, limit, is_needed):
    fit = of_elbow.fit
    less = replace(fit, squares=1.5**2 * fit.squares)
    assert not of_elbow.problem.is_near_noise(less)
    assert _is_needed(of_elbow.problem, less, fit, np.inf, limits(limit, fit)) is is_needed
    lost = of_elbow.problem.gained(less.squares, fit.squares)
    assert _is_needed(of_elbow.problem, less, fit, 4.0 * lost, limits(limit, fit)), "a quarter of what was gained goes"
