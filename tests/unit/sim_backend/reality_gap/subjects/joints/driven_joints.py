"""Three joints without gravity that a controller leads along sines, by MuJoCo itself; apart from the code that studies them."""

from typing import Any

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.look import JointProblem

NAMES = ("first", "second", "third")
INERTIA_KG_M2 = 0.004
STEP_S = 1e-3
STIFF_SOLREF, STIFF_SOLIMP = (0.002, 1.0), 0.999
"""MuJoCo's own blur friction over tenths of a radian per second."""
NO_LIMIT = JointState(3, {"torque_saturation.limit_nm": np.full(3, 10.0)})
_PERIODS_S = np.array([[1.7, 0.61], [2.3, 0.47], [1.3, 0.83]])


def joints_model(frictionloss=(0.0, 0.0, 0.0)) -> mujoco.MjModel:
    """As many joints as frictions; each turns a link of its own about a vertical axis; ranges of 1.5 rad to both sides."""
    bodies = "".join(
        f'<body pos="{j} 0 0">'
        f'<joint name="{name}" axis="0 0 1" limited="true" range="-1.5 1.5" frictionloss="{frictionloss[j]}"/>'
        f'<inertial pos="0 0 0" mass="0.1" diaginertia="0.003 0.003 {INERTIA_KG_M2}"/></body>'
        for j, name in enumerate(NAMES[: len(frictionloss)])
    )
    spec = f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" integrator="Euler"/><worldbody>{bodies}</worldbody>'
    actuators = "".join(f'<motor joint="{name}"/>' for name in NAMES[: len(frictionloss)])
    model = mujoco.MjModel.from_xml_string(f"{spec}<actuator>{actuators}</actuator></mujoco>")
    model.dof_solref[:], model.dof_solimp[:, :2] = STIFF_SOLREF, STIFF_SOLIMP
    return model


def drive(model: mujoco.MjModel, seconds: float, missing_nm=lambda velocity: 0.0 * velocity) -> tuple[np.ndarray, np.ndarray]:
    """Positions and sent torques, each (s, 3); ``missing_nm`` of the velocities (3,) is sent but does not arrive."""
    data, steps = mujoco.MjData(model), round(seconds / STEP_S)
    position, torque = np.empty((steps, 3)), np.empty((steps, 3))
    for step in range(steps):
        target = (0.4 * np.sin(2 * np.pi * (step * STEP_S / _PERIODS_S + [[0.0], [0.3], [0.6]]))).sum(axis=1)
        position[step] = data.qpos
        torque[step] = 2.0 * (target - data.qpos) - 0.1 * data.qvel
        data.ctrl[:] = torque[step] - missing_nm(data.qvel)
        mujoco.mj_step(model, data)
    return position, torque


def recording(position: np.ndarray, torque: np.ndarray, name: str = "made", **channels: Any) -> Recording:
    """As a file would give it."""
    joints = JointSignals(NAMES[: position.shape[1]], position, commanded_torque_nm=torque, **channels)
    return Recording(name, "made", STEP_S, STEP_S * np.arange(len(position)), joints)


def episode(position: np.ndarray, torque: np.ndarray, **channels: Any) -> EpisodeEquations:
    """Its equations with the model without friction, of as many joints as positions are of."""
    path, joints = trajectory(recording(position, torque, **channels)), position.shape[1]
    return EpisodeEquations(Plant(joints_model((0.0,) * joints), NAMES[:joints]), path, 0, robot=KnownTriFinger(NO_SESSIONS))


def problem(position: np.ndarray, torque: np.ndarray) -> JointProblem:
    """A problem of one episode whose accelerations decide, as in studies of TriFingers."""
    return JointProblem((episode(position, torque),), NAMES, UnknownRobot(), (), NO_LIMIT)


def foreign_problem(position: np.ndarray, torque: np.ndarray) -> JointProblem:
    """A problem of one episode whose torques are compared, as in studies of anybody's robots."""
    path = trajectory(recording(position, torque), cutoff_hz=UnknownRobot.cutoff_hz)
    episode = EpisodeEquations(Plant(joints_model(), NAMES), path, 0, robot=UnknownRobot())
    return JointProblem((episode,), NAMES, UnknownRobot(), (), NO_LIMIT)


def planted_friction(torque_nm: float) -> JointProblem:
    """A problem of anybody's robot with Coulomb friction in the second joint, and a little noise of the encoders."""
    position, torque = drive(joints_model(frictionloss=(0.0, torque_nm, 0.0)), 12.0)
    position += 3e-5 * np.random.default_rng(0).standard_normal(position.shape)
    return foreign_problem(position, torque)
