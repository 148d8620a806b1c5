"""A spring is not named where a joint swings at one pace: less inertia than the model has is the same there."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.springs import perhaps_less_inertia
from sim_backend.reality_gap.verdict import Cause
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import NAMES, STEP_S, arm

TIME_S = np.arange(0.0, 6.0, STEP_S)
ONE_PACE = 0.08 * np.exp(-0.1 * TIME_S) * np.sin(9.0 * TIME_S)
SEVERAL = 0.3 * np.sin(3.0 * TIME_S) + 0.2 * np.sin(9.0 * TIME_S)


def spring(value, where="elbow") -> Cause:
    return Cause("joint_stiffness", "stiffness_nm_rad", where, value, "N m/rad", (0.9 * value, 1.1 * value))


def doubts(elbow, *causes):
    position = np.stack([0.2 * np.sin(2.0 * TIME_S), elbow], axis=1)
    recording = Recording(
        "made", "made", STEP_S, TIME_S, JointSignals(NAMES, position, measured_torque_nm=np.zeros_like(position))
    )
    path = trajectory(recording, cutoff_hz=UnknownRobot.cutoff_hz)
    episodes = (EpisodeEquations(Plant(arm(), NAMES), path, 0, robot=UnknownRobot()),)
    study = SimpleNamespace(problem=SimpleNamespace(names=NAMES, episodes=episodes))
    return perhaps_less_inertia(study, causes)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("elbow", "share", "is_doubted"),
    [(ONE_PACE, 0.4, True), (ONE_PACE, 1.3, False), (SEVERAL, 0.4, False), (ONE_PACE, -0.4, False)],
    ids=["one pace", "more than all of it", "several paces", "pushes away"],
)
def test_a_spring_at_a_joint_that_swings_at_one_pace_may_be_less_inertia(elbow, share, is_doubted):
    """The link's inertia about the elbow is a third of 0.5 kg times 0.25 m squared, and its rotor's 0.002 kg m^2."""
    inertia = 0.5 * 0.25**2 / 3.0 + 0.002
    found = doubts(elbow, spring(share * inertia * 81.0), Cause("coulomb_friction", "torque_nm", "elbow", 0.1, "N m", (0.0, 0.2)))
    assert bool(found) is is_doubted
    if found:
        said = float(found[0].other.split(", ")[1].split("%")[0]) / 100.0
        assert said == pytest.approx(share, abs=0.04)
