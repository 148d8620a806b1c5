"""A hanging arm of two links whose torques come from MuJoCo's inverse dynamics: everything that is wrong with it is planted."""

from typing import Any

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import Verdict

NAMES = ("shoulder", "elbow")
STEP_S, ENCODER_RAD, TORQUE_NM = 0.002, 5e-5, 0.005


def arm() -> mujoco.MjModel:
    """Links of 0.3 and 0.25 m that hang."""
    link = '<geom type="capsule" fromto="0 0 0 0 0 -{0}" size=".02" mass="{1}" contype="0" conaffinity="0"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><joint name="shoulder" axis="0 1 0" armature="0.002"/>{link.format(0.3, 0.9)}'
        f'<body pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" armature="0.002"/>{link.format(0.25, 0.5)}</body></body>'
        "</worldbody></mujoco>"
    )


def motion(seed: int, seconds: float = 5.0, sizes=(0.8, 0.8), offsets=(0.0, 0.0)) -> np.ndarray:
    """Sums of sines of 0.2 to 1.5 Hz, shape (s, 2), rad."""
    rng, time_s = np.random.default_rng(seed), np.arange(0.0, seconds, STEP_S)
    sines = [
        sum(rng.normal() * np.sin(2 * np.pi * rng.uniform(0.2, 1.5) * time_s + rng.uniform(0.0, 6.28)) for _ in range(6))
        for _ in NAMES
    ]
    return np.array(offsets) + np.array(sizes) * np.stack(sines, axis=1) / np.sqrt(6.0)


def torques_nm(position: np.ndarray, model: mujoco.MjModel | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Torques that a healthy arm needs, or another one, and its velocities; shapes (s, 2)."""
    model = arm() if model is None else model
    velocity = np.gradient(position, STEP_S, axis=0)
    acceleration = np.gradient(velocity, STEP_S, axis=0)
    data, torque = mujoco.MjData(model), np.empty_like(position)
    for row in range(len(position)):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[row], velocity[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        torque[row] = data.qfrc_inverse
    return torque, velocity


def friction(velocity: np.ndarray, coulomb_nm=(0.0, 0.0)) -> np.ndarray:
    """Coulomb friction, shape (s, 2)."""
    return np.array(coulomb_nm) * np.tanh(velocity / 0.01)


def recording(position: np.ndarray, torque: np.ndarray, seed: int, **channels: Any) -> Recording:
    """As a file would give it, with noise of the sensors."""
    rng = np.random.default_rng(1000 + seed)
    position = position + ENCODER_RAD * rng.standard_normal(position.shape)
    torque = torque + TORQUE_NM * rng.standard_normal(torque.shape)
    joints = JointSignals(NAMES, position, measured_torque_nm=torque, **channels)
    return Recording(f"run {seed}", "arm.csv", STEP_S, STEP_S * np.arange(len(position)), joints)


def recorded(seed: int, coulomb_nm=(0.0, 0.0), **how) -> Recording:
    """An episode of an arm with friction."""
    position = motion(seed, **how)
    torque, velocity = torques_nm(position)
    return recording(position, torque + friction(velocity, coulomb_nm), seed)


def study_of(recordings: list[Recording]) -> JointStudy:
    """A study as of anybody's robot."""
    return study_joints(arm(), recordings, lambda *_: None, robot=UnknownRobot())


def verdict_of(recordings: list[Recording]) -> Verdict:
    """Its verdict."""
    return judge(study_of(recordings)).verdict
