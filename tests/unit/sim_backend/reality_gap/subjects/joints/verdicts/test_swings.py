"""What the period of a swing does not tell apart is not named: springs and less inertia, gravity and the pace of the clock."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.swings import perhaps_another_pace, perhaps_less_inertia
from sim_backend.reality_gap.verdict import Cause
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import NAMES, STEP_S, arm

TIME_S = np.arange(0.0, 6.0, STEP_S)
ONE_PACE = 0.08 * np.exp(-0.1 * TIME_S) * np.sin(9.0 * TIME_S)
SEVERAL = 0.3 * np.sin(3.0 * TIME_S) + 0.2 * np.sin(9.0 * TIME_S)


def spring(value, where="elbow") -> Cause:
    return Cause("joint_stiffness", "stiffness_nm_rad", where, value, "N m/rad", (0.9 * value, 1.1 * value))


def study_of(elbow, torque_nm=0.0, stated=None):
    """Of an arm whose model has what is ``stated``."""
    position = np.stack([0.2 * np.sin(2.0 * TIME_S), elbow], axis=1)
    recording = Recording(
        "made", "made", STEP_S, TIME_S, JointSignals(NAMES, position, measured_torque_nm=np.full_like(position, torque_nm))
    )
    path = trajectory(recording, cutoff_hz=UnknownRobot.cutoff_hz)
    episodes = (EpisodeEquations(Plant(arm(), NAMES), path, 0, robot=UnknownRobot()),)
    start = JointState(2, {key: np.array(values) for key, values in (stated or {}).items()})
    problem = SimpleNamespace(names=NAMES, episodes=episodes)
    return SimpleNamespace(problem=problem, start=start, problem_start=lambda key, j: float(start.value(key)[j]))


@pytest.mark.parametrize(
    ("elbow", "share", "is_doubted"),
    [(ONE_PACE, 0.4, True), (ONE_PACE, 1.3, False), (SEVERAL, 0.4, False), (ONE_PACE, -0.4, False)],
    ids=["one pace", "more than all of it", "several paces", "pushes away"],
)
def test_a_spring_at_a_joint_that_swings_at_one_pace_may_be_less_inertia(elbow, share, is_doubted):
    """The link's inertia about the elbow is a third of 0.5 kg times 0.25 m squared, and its rotor's 0.002 kg m^2."""
    inertia = 0.5 * 0.25**2 / 3.0 + 0.002
    causes = [spring(share * inertia * 81.0), Cause("coulomb_friction", "torque_nm", "elbow", 0.1, "N m", (0.0, 0.2))]
    found = perhaps_less_inertia(study_of(elbow), causes)  # pyrefly: ignore[bad-argument-type]
    assert bool(found) is is_doubted
    if found:
        said = float(found[0].other.split(", ")[1].split("%")[0]) / 100.0
        assert said == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize(
    ("offset", "torque_nm", "said"),
    [({"z": 7.5}, 0.0, "0.485 s"), ({"z": -2.0}, 0.0, "1.1 s"), ({"z": 7.5}, 0.1, ""), ({"x": 4.0}, 0.0, "")],
    ids=["weaker", "stronger", "driven", "tilted"],
)
def test_gravity_of_another_size_may_be_the_clock_where_nothing_drives_a_joint(offset, torque_nm, said):
    causes = [Cause("gravity", "offset_m_s2", axis, by, "m/s^2", (by - 0.5, by + 0.5)) for axis, by in offset.items()]
    found = perhaps_another_pace(study_of(SEVERAL, torque_nm), causes)  # pyrefly: ignore[bad-argument-type]
    assert bool(found) is bool(said)
    if found:
        assert found[0].cause == causes[0] and found[0].other.startswith(f"a second of the recordings is {said}: ")


def test_of_springs_at_no_joint_of_its_own_nothing_is_said():
    assert perhaps_less_inertia(study_of(ONE_PACE), [spring(0.6, "all joints")]) == []  # pyrefly: ignore[bad-argument-type]


def test_a_spring_is_compared_with_the_one_that_the_model_has():
    nominal = {"joint_stiffness.stiffness_nm_rad": [0.0, 0.8]}
    weaker, stronger = (perhaps_less_inertia(study_of(ONE_PACE, stated=nominal), [spring(value)]) for value in (0.6, 1.0))  # pyrefly: ignore[bad-argument-type]
    assert (bool(weaker), bool(stronger)) == (False, True)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"gravity.offset_m_s2": [0.0, 0.0, 8.19]}, "0.903 s"),
        ({"joint_stiffness.stiffness_nm_rad": [0.0, 0.8]}, ""),
    ],
    ids=["on the moon", "with a spring"],
)
def test_a_clock_is_compared_with_stated_gravity_and_not_where_a_spring_acts(stated, said):
    cause = Cause("gravity", "offset_m_s2", "z", 8.49, "m/s^2", (8.4, 8.6))
    found = perhaps_another_pace(study_of(SEVERAL, stated=stated), [cause])  # pyrefly: ignore[bad-argument-type]
    assert bool(found) is bool(said)
    assert said in "".join(doubt.other for doubt in found)
