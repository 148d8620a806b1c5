"""Laws without a name in the catalogue, and shares of everything, keep causes from being named that look like them."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.healthy_robots import draw_healthy
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.rollout_fit import RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollout_selection import select_by_rollouts
from sim_backend.reality_gap.subjects.joints.unnamed_rivals import against_unnamed, with_late_columns, with_share_of_all
from sim_backend.reality_gap.subjects.joints.verdict_of_rollouts import verdict_of_rollouts
from sim_backend.reality_gap.verdict import Cause, EffectJudged, Told, Verdict, VerdictKind

PENDULUM = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody>
 <body name="arm"><joint name="hinge" axis="0 1 0" armature="0.001"/>
  <inertial pos="0 0 -0.2" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body>
</worldbody></mujoco>
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


def test_drag_of_the_air_is_not_called_viscous_friction():
    model, robot = mujoco.MjModel.from_xml_string(PENDULUM), UnknownRobot(Tolerance())
    study = study_joints(model, [swung(1.6, 1), swung(-1.1, 2)], lambda *_: None, robot=robot, gate=np.inf)
    catalogue = study.fit.first.catalogue
    problem = RolloutProblem(study.problem.episodes, study.start, catalogue, robot.tolerance)
    selection = select_by_rollouts(problem, catalogue, lambda _: True)
    before = verdict_of_rollouts(study, selection, draw_healthy(problem, np.random.default_rng(0), draws=20))
    assert {cause.effect for cause in before.causes} <= {"viscous_friction", "coulomb_friction", "load_friction"}
    found = against_unnamed(before, selection)
    assert found.verdict is VerdictKind.UNEXPLAINED and "square of speed" in found.summary


def masses(*factors: tuple[str, float]) -> Verdict:
    causes = tuple(Cause("link_mass", "factor", name, value, "1", (value - 0.03, value + 0.03)) for name, value in factors)
    return Verdict(verdict=VerdictKind.NAMED, summary="Masses.", causes=causes)


def test_all_masses_by_one_share_may_be_all_torques():
    found = with_share_of_all(masses(("upper", 0.75), ("lower", 0.74)), ("upper", "lower"))
    assert found.verdict is VerdictKind.CONFUSABLE and found.record_next
    constants = {cause.where: cause.value for cause in found.causes if cause.effect == "torque_constant"}
    assert constants == {"upper": pytest.approx(1 / 0.75 - 1), "lower": pytest.approx(1 / 0.74 - 1)}


@pytest.mark.parametrize("factors", [(("upper", 0.75),), (("upper", 0.75), ("lower", 0.9))])
def test_masses_that_are_off_each_by_its_own_are_named(factors):
    assert with_share_of_all(masses(*factors), ("upper", "lower")).verdict is VerdictKind.NAMED


@pytest.mark.parametrize("joints", [("lower",), ("upper", "lower")])
def test_a_delay_that_motions_alone_tell_may_be_late_positions(joints):
    delays = [Cause("action_delay", "delay_s", name, 0.008, "s", (0.007, 0.009)) for name in joints]
    judged = (EffectJudged("action_delay", Told.NAMED), EffectJudged("gravity", Told.EXCLUDED, 0.1, "m/s^2"))
    found = with_late_columns(Verdict(VerdictKind.NAMED, "A delay.", causes=tuple(delays), effects=judged))
    assert found.verdict is VerdictKind.CONFUSABLE and found.causes == tuple(delays)
    assert "written 8" in found.summary and any("current" in said for said in found.record_next)
    assert [each.told for each in found.effects] == [Told.CONFUSABLE, Told.EXCLUDED]


def test_causes_without_a_delay_stay_named():
    verdict = masses(("upper", 0.75))
    assert with_late_columns(verdict) == verdict
