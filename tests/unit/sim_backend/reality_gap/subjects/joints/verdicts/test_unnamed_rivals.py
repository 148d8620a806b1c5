"""Laws without a name in the catalogue keep causes from being named that look like them."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.knowledge.unnamed_laws import DRAG
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import select_by_rollouts
from sim_backend.reality_gap.subjects.joints.verdicts.unnamed_rivals import _as_lossy, against_unnamed
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_rollouts import verdict_of_rollouts
from sim_backend.reality_gap.verdict import VerdictKind

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
    before = verdict_of_rollouts(study, selection, DrawnRobots(problem, np.random.default_rng(0), draws=20).coarse)
    assert {cause.effect for cause in before.causes} <= {"viscous_friction", "coulomb_friction", "load_friction"}
    found = against_unnamed(before, selection, FAR_OFF * problem.noise_rad)
    assert found.verdict is VerdictKind.UNEXPLAINED and "square of speed" in found.summary


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
