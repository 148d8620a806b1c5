"""Torques that a heavier link or a load makes larger are not in another unit, and those in another unit need no load."""

import re

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.nominal import nominal_state
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.torques.equations import equations_of
from sim_backend.reality_gap.subjects.joints.verdicts.misreadings import misreading
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import (
    STEP_S,
    arm,
    friction,
    motion,
    recording,
    torques_nm,
    verdict_of,
)
from tests.unit.sim_backend.reality_gap.subjects.joints.verdicts.test_misread_swings import rod

FRICTION_NM = (0.2, 0.1)


def loaded(link: str) -> mujoco.MjModel:
    """The arm with more than it is said to have: its lower link thrice as heavy, or 1.2 kg at its end."""
    model = arm()
    if link == "heavy":
        model.body_mass[2] *= 3.0
        model.body_inertia[2] *= 3.0
        return model
    mass, load, (*_, centre), end = model.body_mass[2], 1.2, model.body_ipos[2], -0.25
    both = (mass * centre + load * end) / (mass + load)
    model.body_inertia[2, :2] += mass * (both - centre) ** 2 + load * (both - end) ** 2
    model.body_mass[2], model.body_ipos[2, 2] = mass + load, both
    return model


@pytest.mark.parametrize(
    ("link", "said"),
    [("heavy", "what elbow moves is 3 times as heavy as in the model"), ("end", "elbow carries a load that the model lacks")],
)
def test_a_payload_that_the_model_lacks_is_no_unit_of_torques(link, said):
    recordings = []
    for seed in (1, 2):
        position = motion(seed)
        torque, velocity = torques_nm(position, loaded(link))
        recordings.append(recording(position, torque + friction(velocity, FRICTION_NM), seed))
    verdict = verdict_of(recordings)
    assert (verdict.misreads, verdict.causes) == (said, ())
    assert "the mass that elbow carries" in verdict.record_next[0]


@pytest.mark.parametrize(
    ("larger", "zero_rad", "said"),
    [
        (5.0, 0.1, r"the torques of hinge are [45]\.?\d* times smaller, or hinge carries a load that the model lacks"),
        (100.0, 0.0, r"the torques of hinge are 100 times smaller \(as if N cm were read as N m\)"),
    ],
    ids=["zero a little off", "N cm"],
)
def test_a_load_with_as_many_numbers_as_a_joint_shows_takes_no_units_place(larger, zero_rad, said):
    """With inertia, mass and centre set free any torque of a single pendulum is a load's."""
    model, recordings = rod(), []
    model.dof_armature[0] = 0.001
    for seed in (1, 2):
        position = motion(seed)[:, :1]
        torque, velocity = torques_nm(position, model)
        told = larger * (torque + 0.01 * np.tanh(velocity / 0.01))
        joints = JointSignals(("hinge",), position + zero_rad, measured_torque_nm=told)
        recordings.append(Recording(f"run {seed}", "rod.csv", STEP_S, STEP_S * np.arange(len(position)), joints))
    verdict = judge(study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())).verdict
    assert re.fullmatch(said, verdict.misreads), verdict.misreads


def test_a_link_that_explains_nothing_is_not_said_beside_torques_that_are_something_else():
    """A counterweight that pulls harder than the arm at its shoulder: no mass at the elbow takes any of that."""
    episodes, plant = [], Plant(arm(), ("shoulder", "elbow"))
    for seed in (1, 2):
        position = motion(seed)
        torque, velocity = torques_nm(position)
        torque[:, 0] -= 5.0 * np.sin(position[:, 0])
        episodes.append(
            equations_of(plant, recording(position, torque + friction(velocity, FRICTION_NM), seed), 0, UnknownRobot())
        )
    start = nominal_state(plant, [episode.driving_nm for episode in episodes], UnknownRobot(), {})
    found = misreading(episodes, start, plant.names, np.full(2, np.inf))
    assert found is not None and "mostly not the joint's own" in found.said
    assert "heavy" not in found.said
