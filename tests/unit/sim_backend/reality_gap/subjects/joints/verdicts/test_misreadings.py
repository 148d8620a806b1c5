"""Wrong signs, units and clocks of anybody's recordings are said, and never named as causes."""

import re
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.joint_effects import TORQUE_CONSTANT
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.verdicts.misreadings import misreading
from sim_backend.reality_gap.subjects.joints.verdicts.readings import TorqueRows, free_columns
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import PLAUSIBLE_FACTOR, with_torques, without_sign
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import (
    STEP_S,
    arm,
    friction,
    motion,
    recorded,
    recording,
    torques_nm,
    verdict_of,
)

FRICTION_NM = (0.2, 0.1)
Told = tuple[np.ndarray, np.ndarray]
ELBOW = np.array([1.0, -1.0])
LEVEL, UP = np.array([np.pi / 2.0, 0.0]), np.array([np.pi, 0.0])
SHOULDER_S_TOO = np.array([[1.0, 10.0], [0.0, 1.0]])
MISREAD: dict[str, tuple[Callable[[np.ndarray, np.ndarray], Told], str]] = {
    "torque turned": (lambda q, t: (q, -t), "the torques of shoulder and elbow have the opposite sign"),
    "torque turned, and a tenth less": (lambda q, t: (q, -0.9 * t), "the torques of shoulder and elbow have the opposite sign"),
    "one torque turned": (lambda q, t: (q, t * ELBOW), "the torques of elbow have the opposite sign"),
    "one position turned": (lambda q, t: (q * ELBOW, t), "the positions of elbow count the other way round"),
    "one joint turned": (lambda q, t: (q * ELBOW, t * ELBOW), "elbow counts the other way round, position and torque"),
    "N cm": (lambda q, t: (q, 1e2 * t), "the torques of shoulder and elbow are 100 times smaller (as if N cm were read as N m)"),
    "ampere": (lambda q, t: (q, t / 0.1), "the torques of shoulder and elbow are 10 times smaller"),
    "another's torque": (lambda q, t: (q, t @ SHOULDER_S_TOO), "the torques of elbow are mostly not the joint's own"),
    "counted from above": (lambda q, t: (q + UP, t), "the zero of shoulder is half a turn away from the model's"),
    "counted from the level": (
        lambda q, t: (q - [np.pi / 2.0, 0.0], t),
        "the zero of shoulder is a quarter turn away from the model's",
    ),
    "degrees": (lambda q, t: (np.degrees(q), t), "the positions of shoulder and elbow are in degrees, not in rad"),
    "one in degrees": (lambda q, t: (q * [1.0, 180 / np.pi], t), "the positions of elbow are in degrees, not in rad"),
    "late torque": (lambda q, t: (q, np.roll(t, 10, axis=0)), "the torques acted 20 ms earlier than they are dated"),
}


@pytest.mark.filterwarnings("ignore:An ill-conditioned matrix")  # torques a hundred times too large beside one noise
@pytest.mark.parametrize("name", MISREAD)
def test_what_was_misread_is_said_and_no_cause_is_named(name):
    told, said = MISREAD[name]
    recordings = []
    for seed in (1, 2):
        position = motion(seed)
        torque, velocity = torques_nm(position)
        recordings.append(recording(*told(position, torque + friction(velocity, FRICTION_NM)), seed))
    verdict = verdict_of(recordings)
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert verdict.causes == ()
    assert said in verdict.follows[0].split(", or ")
    assert said in verdict.summary
    assert verdict.record_next[0].startswith("nothing yet: check ")
    assert "torque_sign" in verdict.record_next[0] or "opposite sign" not in said


@pytest.mark.parametrize(
    ("gravity_nm", "factor", "said", "check"),
    [
        (
            0.0,
            1.0,
            "the torques of wheel are 5 times smaller, or the model lacks rotor inertia at wheel",
            "the armature of wheel in the model and torque_unit of wheel",
        ),
        (0.5, 1.0, "the torques of wheel are 5 times smaller", "torque_unit of wheel"),
        (
            0.0,
            -1.0,
            "the torques of wheel are 5 times smaller and have the opposite sign",
            "torque_unit and torque_sign of wheel",
        ),
        (0.5, -0.2, "the torques of wheel have the opposite sign", "torque_sign of wheel"),
    ],
    ids=["no gravity", "gravity", "turned, too", "turned alone"],
)
def test_without_gravity_rotor_inertia_that_the_model_lacks_is_said_beside_another_unit(gravity_nm, factor, said, check):
    time_s = np.arange(0.0, 8.0, 0.01)
    position = np.sin(7.0 * time_s) + 0.4 * np.sin(11.0 * time_s + 1.0)
    velocity = np.gradient(position, time_s)
    acceleration = np.gradient(velocity, time_s)
    free = np.stack([np.tanh(velocity / 0.02), velocity, np.ones_like(velocity)], axis=1)
    needed = 0.01 * acceleration + gravity_nm * np.sin(position)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(needed))
    rows = TorqueRows(factor * (5.0 * needed + 0.3 * free[:, 0]) + noise, needed, free, acceleration)
    (misreading,) = with_torques([rows], ["wheel"], "", "", (), np.ones(1))
    found = re.sub(r"[45]\.\d+ times", "5 times", misreading.said)
    assert (found, misreading.check) == (said, check)


def test_torques_of_motors_are_said_where_the_model_has_the_friction_of_its_gears():
    """Simulated motions have the model's friction, and not only what is beyond it."""
    model, friction_nm, gears = arm(), (0.8, 0.3), np.array([50.0, 20.0])
    model.dof_frictionloss[:] = friction_nm
    recordings = []
    for seed in (1, 2):
        position = motion(seed)
        torque, velocity = torques_nm(position)
        recordings.append(recording(position, (torque + friction(velocity, friction_nm)) / gears, seed))
    verdict = judge(study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())).verdict
    assert (verdict.verdict, verdict.causes) == (VerdictKind.UNEXPLAINED, ())
    said = re.fullmatch(
        r"the torques of shoulder are (\S+) times larger and the torques of elbow are (\S+) times larger", verdict.misreads
    )
    assert said is not None, verdict.misreads
    assert [float(each) for each in said.groups()] == pytest.approx(gears, rel=0.03)


@pytest.mark.parametrize(
    ("size", "bent_rad", "is_said"), [(0.8, 0.0, True), (0.15, 1.2, False)], ids=["both ways", "a load that is held"]
)
def test_torques_that_lost_their_sign_are_said_and_those_that_need_none_are_not(size, bent_rad, is_said):
    recordings = [recorded(seed, FRICTION_NM, sizes=(size, size), offsets=(0.0, bent_rad)) for seed in (1, 2)]
    verdict = verdict_of([_without_sign_of_elbow(recording) for recording in recordings])
    assert (verdict.misreads == "the torques of elbow are sizes without a sign") is is_said
    assert ("never change their sign" in verdict.summary) is is_said
    assert (verdict.verdict is VerdictKind.UNEXPLAINED and verdict.causes == ()) is is_said


def test_torques_that_stay_on_one_side_for_another_reason_have_a_sign():
    time_s = np.arange(0.0, 8.0, 0.01)
    needed = np.sin(7.0 * time_s) + 0.4 * np.sin(11.0 * time_s + 1.0)
    one_way = 8.0 + 3.0 * np.sin(0.7 * time_s)

    def found(given, velocity):
        return without_sign([TorqueRows(given, needed, free_columns(velocity), np.zeros_like(needed))])

    to_and_fro = np.cos(5.0 * time_s)
    astray = np.abs(needed)
    astray[100] = -1.0
    assert found(np.abs(needed), to_and_fro) == found(astray, to_and_fro) == [0]
    assert found(needed + 2.0 + 0.1 * one_way, one_way) == [], "a wheel that rubs"
    assert found(needed + 2.0, to_and_fro) == [], "a base that leans"
    assert found(needed, to_and_fro) == found(0.0 * needed, to_and_fro) == []
    assert without_sign([TorqueRows(np.ones(3), np.ones(3), free_columns(np.ones(3)), np.ones(3))]) == []


def _without_sign_of_elbow(recording: Recording) -> Recording:
    """As a driver gives it that reports how large a current is."""
    joints = recording.joints
    assert joints is not None and joints.measured_torque_nm is not None
    torques = joints.measured_torque_nm
    told = np.column_stack([torques[:, 0], np.abs(torques[:, 1])])
    return replace(recording, joints=replace(joints, measured_torque_nm=told))


@pytest.mark.parametrize(("told_s", "is_said"), [(1.06, True), (0.9, True), (1.01, False)])
def test_a_clock_that_runs_slow_or_fast_is_said(told_s, is_said):
    recordings = [recorded(seed, FRICTION_NM) for seed in (1, 2)]
    verdict = verdict_of([replace(r, step_s=told_s * r.step_s, time_s=told_s * r.time_s) for r in recordings])
    assert (verdict.misreads == f"a second of the recordings is {1.0 / told_s:.3g} s") is is_said
    assert bool(verdict.misreads) is is_said and (verdict.causes == ()) is is_said


def test_a_joint_that_hardly_moves_does_not_hide_a_clock():
    """Torques with noise drive it elsewhere by more than it moved, whatever the clock is."""
    recordings = []
    for seed in (1, 2):
        position = motion(seed, sizes=(0.8, 0.003), offsets=(0.0, 0.8))
        torque, velocity = torques_nm(position)
        told = recording(position, torque + friction(velocity, FRICTION_NM), seed)
        recordings.append(replace(told, step_s=1.1 * told.step_s, time_s=1.1 * told.time_s))
    assert verdict_of(recordings).misreads == "a second of the recordings is 0.909 s"


@pytest.mark.parametrize("damping", [0.0, 3.0])
@pytest.mark.parametrize(
    ("by", "torques", "positions"),
    [
        (np.pi / 180.0, "the torques of hinge are 57.3 times smaller", "the positions of hinge are in rad, not in degrees"),
        (-1.0, "the torques of hinge have the opposite sign", "the positions of hinge count the other way round"),
    ],
    ids=["degrees", "turned"],
)
def test_of_a_joint_without_gravity_torques_are_said_beside_positions(by, torques, positions, damping):
    """A wheel that moves 57 times as far takes 57 times the torque, whatever damps it in the model, too."""
    wheel = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><joint name="hinge" axis="0 0 1" damping="{damping}"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body></worldbody></mujoco>'
    )
    position = motion(1, seconds=8.0)[:, :1]
    velocity = np.gradient(position, STEP_S, axis=0)
    torque = damping * velocity + 0.1 * np.gradient(velocity, STEP_S, axis=0)
    joints = JointSignals(("hinge",), by * position, measured_torque_nm=torque)
    told = Recording("wheel", "wheel.csv", STEP_S, STEP_S * np.arange(len(position)), joints)
    said = judge(study_joints(wheel, [told], lambda *_: None, robot=UnknownRobot())).verdict.misreads
    assert torques in said and positions in said


def test_a_model_with_another_inertia_is_said_beside_another_clock_where_both_do_as_well():
    """Of one joint they are the same: a clock slows down what inertia takes, and gravity takes as much as before."""
    model, recordings = arm(), []
    model.body_inertia[1] += 0.06
    for seed in (1, 2):
        position = motion(seed) * [1.0, 0.0]
        joints = JointSignals(("shoulder",), position[:, :1], measured_torque_nm=torques_nm(position)[0][:, :1])
        recordings.append(Recording(f"run {seed}", "arm.csv", STEP_S, STEP_S * np.arange(len(position)), joints))
    study = study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())
    found = misreading(study.problem.episodes, study.start, study.problem.names, np.full(1, np.inf))
    said = r"a second of the recordings is 1\.\d+ s(?: or more)?, or the model has too much inertia at shoulder"
    assert found is not None
    assert re.fullmatch(said, found.said)


@pytest.mark.parametrize("pace", [1.0, 1.2])
def test_clocks_and_torques_on_one_side_are_not_judged_by_few_rows(pace):
    position = motion(1, seconds=2.8)
    torque, _ = torques_nm(position)
    short = recording(position, torque if pace != 1.0 else np.abs(torque), 1)
    told = replace(short, step_s=pace * short.step_s, time_s=pace * short.time_s)
    assert verdict_of([told]).misreads == ""


def test_signs_show_where_rows_are_too_few_for_causes():
    """Of a torque that is turned there is no doubt, in less than a motion that tells frictions apart, too."""
    position = motion(1, seconds=2.8)
    torque, _ = torques_nm(position)
    verdict = verdict_of([recording(position, -torque, 1)])
    assert verdict.misreads.startswith("the torques of shoulder and elbow have the opposite sign")


@pytest.mark.parametrize("coulomb_nm", [(0.6, 0.05), (0.1, 0.3)])
def test_an_arm_that_hangs_and_its_mirror_image_are_one_whatever_rubs_in_the_model(coulomb_nm):
    model, recordings = arm(), []
    model.dof_frictionloss[:] = coulomb_nm
    for seed in (1, 2):
        position = motion(seed)
        torque, velocity = torques_nm(position)
        recordings.append(recording(position * ELBOW, 1.02 * (torque + friction(velocity, coulomb_nm)) * ELBOW, seed))
    verdict = judge(study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())).verdict
    turned = [f"{name} counts the other way round, position and torque" for name in ("shoulder", "elbow")]
    assert verdict.misreads == ", or ".join(turned)


def test_between_a_motors_constant_and_another_unit_there_is_no_factor_that_nobody_asks_for():
    low, high = JointState(1).bounds(TORQUE_CONSTANT)
    assert 1.0 + low < 1.0 / PLAUSIBLE_FACTOR and 1.0 + high > PLAUSIBLE_FACTOR
