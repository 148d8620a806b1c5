"""A gravity that pulls another way is said beside a zero that lies elsewhere."""

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.nominal import nominal_state
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.torques.equations import equations_of
from sim_backend.reality_gap.subjects.joints.verdicts.misreadings import misreading
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import (
    STEP_S,
    motion,
    torques_nm,
)


def turning_arm(gravity_m_s2: float) -> mujoco.MjModel:
    """The arm on a base that turns about the vertical."""
    link = '<geom type="capsule" fromto="0 0 0 0 0 -{0}" size=".02" mass="{1}" contype="0" conaffinity="0"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 {gravity_m_s2}"/><worldbody><body><joint name="base" axis="0 0 1" armature="0.01"/>'
        f'{link.format(0.1, 0.5)}<body pos="0 0 -0.1"><joint name="shoulder" axis="0 1 0" armature="0.002"/>'
        f'{link.format(0.3, 0.9)}<body pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" armature="0.002"/>'
        f"{link.format(0.25, 0.5)}</body></body></body></worldbody></mujoco>"
    )


def test_a_robot_that_stands_where_its_model_hangs_need_not_have_another_zero():
    """On a base that turns about the vertical, too: which joint carries all others does not matter."""
    names, episodes, plant = ("base", "shoulder", "elbow"), [], Plant(turning_arm(-9.81), ("base", "shoulder", "elbow"))
    for seed in (1, 2):
        position = np.column_stack([motion(seed + 50)[:, :1], motion(seed, offsets=(0.7, 0.8))])
        torque, velocity = torques_nm(position, turning_arm(9.81))
        told = torque + 0.1 * np.tanh(velocity / 0.01) + 0.005 * np.random.default_rng(seed).standard_normal(torque.shape)
        joints = JointSignals(names, position, measured_torque_nm=told)
        run = Recording(f"run {seed}", "arm.csv", STEP_S, STEP_S * np.arange(len(position)), joints)
        episodes.append(equations_of(plant, run, seed - 1, UnknownRobot()))
    start = nominal_state(plant, [episode.driving_nm for episode in episodes], UnknownRobot(), {})
    found = misreading(episodes, start, names, np.full(3, np.inf))
    assert found is not None
    assert found.said == "the zero of shoulder is half a turn away from the model's, or gravity pulls another way"
