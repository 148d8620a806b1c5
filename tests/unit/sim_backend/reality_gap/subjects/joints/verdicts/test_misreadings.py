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
from sim_backend.reality_gap.subjects.joints.laws.nominal import nominal_state
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.slides import Slides
from sim_backend.reality_gap.subjects.joints.torques.equations import equations_of
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


def swings(model: mujoco.MjModel, seconds: float = 6.0) -> np.ndarray:
    """Angles of a pendulum that is let go from level, at 50 Hz in steps of a 4096th of a turn, shape (t,), rad."""
    data, steps = mujoco.MjData(model), round(0.02 / model.opt.timestep)
    data.qpos[0], found = 1.6, []
    for _ in range(round(seconds / 0.02)):
        found.append(data.qpos[0])
        mujoco.mj_step(model, data, steps)
    return np.round(np.array(found) * 4096 / (2.0 * np.pi)) * 2.0 * np.pi / 4096


def rod(inertia: float = 1.0, damping: float = 0.0) -> mujoco.MjModel:
    """A rod of 0.383 m; its inertia about its centre is told with a factor."""
    about = inertia * 0.087 * 0.383**2 / 12.0
    inertial = f'<inertial pos="0 0 -0.1915" mass="0.087" diaginertia="{about} {about} 1e-7"/>'
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.0005"/><worldbody><body>'
        f'<joint name="hinge" axis="0 1 0" damping="{damping}"/>{inertial}</body></worldbody></mujoco>'
    )


@pytest.mark.parametrize(
    ("inertia", "by", "zero_rad", "said"),
    [
        (2.0, 1.0, 0.0, ""),
        (1.0, 1.0, np.pi, "the zero of hinge is half a turn away from the model's, or gravity pulls another way"),
        (1.0, 180.0 / np.pi, 0.0, "the positions of hinge are in degrees, not in rad"),
    ],
    ids=["inertia", "up", "degrees"],
)
def test_a_swing_that_nothing_drives_is_not_nearer_because_its_numbers_are_smaller(inertia, by, zero_rad, said):
    """In any smaller unit such a joint's equation leaves less, and the sine of gravity leaves nothing."""
    position = (by * swings(rod(damping=1e-4)) + zero_rad)[:, None]
    joints = JointSignals(("hinge",), position, measured_torque_nm=np.zeros_like(position))
    told = Recording("swing", "pole.csv", 0.02, 0.02 * np.arange(len(position)), joints)
    verdict = judge(study_joints(rod(inertia), [told], lambda *_: None, robot=UnknownRobot())).verdict
    assert verdict.misreads == said


def test_what_a_sensor_makes_of_no_torque_drives_nothing():
    """A current that is measured of a motor that is off is not 0: a free swing with it is as free."""
    position = swings(rod(damping=1e-4))[:, None]
    noise_nm = 1e-4 * np.random.default_rng(0).standard_normal(position.shape)
    joints = JointSignals(("hinge",), position, measured_torque_nm=noise_nm)
    told = Recording("swing", "pole.csv", 0.02, 0.02 * np.arange(len(position)), joints)
    assert judge(study_joints(rod(2.0), [told], lambda *_: None, robot=UnknownRobot())).verdict.misreads == ""


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


def cart_pole() -> mujoco.MjModel:
    """A cart on a rail with a pole that hangs."""
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.001"/><worldbody><body><joint name="cart" type="slide" axis="1 0 0" damping="5"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/><body><joint name="pole" axis="0 1 0" damping="1e-3"/>'
        '<inertial pos="0 0 -0.2" mass="0.1" diaginertia="1e-3 1e-3 1e-4"/></body></body></worldbody>'
        '<actuator><motor joint="cart"/></actuator></mujoco>'
    )


def test_columns_of_two_joints_that_were_exchanged_are_no_unit():
    """What a motor elsewhere moves does not move less in smaller numbers."""
    model = cart_pole()
    data, found = mujoco.MjData(model), []
    for time_s in np.arange(0.0, 8.0, 0.01):
        data.ctrl[0] = 12.0 * np.sin(6.0 * time_s) + 6.0 * np.sin(11.4 * time_s) - 20.0 * data.qpos[0]
        found.append((*data.qpos, data.ctrl[0]))
        mujoco.mj_step(model, data, 10)
    cart_m, pole_rad, force_n = np.array(found).T
    slides = Slides.of(model, ("cart", "pole"))
    exchanged = np.stack([pole_rad, cart_m], axis=1)
    joints = JointSignals(("cart", "pole"), exchanged, commanded_torque_nm=np.stack([force_n, np.zeros_like(force_n)], axis=1))
    told = Recording("run", "cart.csv", 0.01, 0.01 * np.arange(len(cart_m)), joints)
    verdict = judge(
        study_joints(slides.model_as_hinges(model), [slides.as_hinges(told)], lambda *_: None, robot=UnknownRobot())
    ).verdict
    assert (verdict.verdict, verdict.misreads) == (VerdictKind.UNEXPLAINED, "")


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


def test_a_pendulum_that_comes_to_rest_in_air_is_not_told_in_degrees():
    """What its sensor makes of rest says nothing about units, and nor does a model that stands still."""
    xml = (
        '<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" armature="0.002" frictionloss="0.03" damping="0.012"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.32" size="0.016" mass="{}" contype="0" conaffinity="0"/></body></worldbody>'
        "</mujoco>"
    )
    robot, recordings, step_s = mujoco.MjModel.from_xml_string(xml.format(0.79)), [], 0.004
    robot.opt.timestep = 0.25 * step_s
    for seed, angle_rad in enumerate((2.2, -1.5, 1.0)):
        data, position = mujoco.MjData(robot), np.empty((5000, 1))
        data.qpos[0] = angle_rad
        for row in range(len(position)):
            position[row] = data.qpos
            for _ in range(4):
                data.qfrc_applied[:] = -0.006 * data.qvel * np.abs(data.qvel)
                mujoco.mj_step(robot, data)
        position = 1e-4 * np.round(1e4 * (position + 3e-5 * np.random.default_rng(seed).standard_normal(position.shape)))
        joints = JointSignals(("hinge",), position, commanded_torque_nm=np.zeros_like(position))
        recordings.append(Recording(f"swing {seed}", "swings.csv", step_s, step_s * np.arange(len(position)), joints))
    model = mujoco.MjModel.from_xml_string(xml.format(0.8))
    assert judge(study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())).verdict.misreads == ""


def test_between_a_motors_constant_and_another_unit_there_is_no_factor_that_nobody_asks_for():
    low, high = JointState(1).bounds(TORQUE_CONSTANT)
    assert 1.0 + low < 1.0 / PLAUSIBLE_FACTOR and 1.0 + high > PLAUSIBLE_FACTOR
