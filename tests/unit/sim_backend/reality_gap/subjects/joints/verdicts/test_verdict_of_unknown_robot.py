"""Verdicts on robots without healthy sessions: nothing is named, or called right, that leaves what is wrong unexplained."""

import re

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.joint_effects import Channel
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.slides import Slides
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import Pattern
from sim_backend.reality_gap.subjects.joints.verdicts.untold import untold
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import _follows, judge
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_unknown_robot import Agreement, reconsidered
from sim_backend.reality_gap.verdict import Verdict, VerdictKind, names_of
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import (
    STEP_S,
    arm,
    friction,
    motion,
    recorded,
    recording,
    study_of,
    torques_nm,
    verdict_of,
)


def agreement(before, after, noise=0.01, judged=True) -> Agreement:
    return Agreement(*(np.array([value]) for value in (judged, before, after, noise)))


@pytest.mark.parametrize(
    ("before", "after", "is_footnote"),
    [
        (1.0, 0.015, False),  # at the noise
        (1.0, 0.7, False),  # half of the variance
        (1.0, 0.95, True),  # a tenth of it
        (0.019, 0.018, False),  # nothing is wrong
    ],
)
def test_a_footnote_leaves_far_more_than_it_takes(before, after, is_footnote):
    assert agreement(before, after).is_footnote.tolist() == [is_footnote]


def test_a_joint_without_equations_is_never_far():
    assert not agreement(1.0, 1.0, judged=False).is_far.any()


def test_friction_is_named_and_a_healthy_arm_has_nothing_wrong():
    assert names_of(verdict_of([recorded(1, (0.2, 0.0)), recorded(2, (0.2, 0.0))]).causes) == {("coulomb_friction", "shoulder")}
    healthy = verdict_of([recorded(3), recorded(4)])
    assert healthy.verdict is VerdictKind.NOTHING_WRONG
    assert not [sentence for sentence in healthy.cannot_tell if "elbow" in sentence]


@pytest.mark.parametrize("driven", [True, False], ids=["motors", "nothing drives it"])
def test_of_a_joint_with_too_few_rows_a_motor_is_said_to_press_only_if_it_has_one(driven):
    position = motion(1, seconds=1.6)
    torque = torques_nm(position)[0] + 0.5 if driven else np.zeros_like(position)
    joints = JointSignals(("shoulder", "elbow"), position, measured_torque_nm=torque)
    short = Recording("run", "arm.csv", STEP_S, STEP_S * np.arange(len(position)), joints)
    verdict = judge(study_joints(arm(), [short], lambda *_: None, robot=UnknownRobot())).verdict
    assert verdict.verdict is VerdictKind.NOT_IDENTIFIABLE
    said = [sentence for sentence in verdict.cannot_tell if "too few rows" in sentence]
    assert len(said) == 2 and all(" by its torques: " in sentence for sentence in said)
    assert all(("its motor gave" in sentence) is driven for sentence in said)
    assert all(re.search(r"\(\d\.\d s of at least \d(\.\d)? s\)", sentence) for sentence in said)
    assert "(shoulder " in verdict.summary and " s of at least " in verdict.summary


def test_what_little_is_left_is_not_said_to_follow_anything():
    found = [Pattern(Channel.MECHANICS, 0, "velocity", 29.4), Pattern(Channel.MECHANICS, 0, "heat", 0.3)]
    assert _follows([*found, Pattern(Channel.MECHANICS, 0, "time", -1.0)], ("wheel",)) == [
        "velocity of wheel (mechanics equation, 29 nats)"
    ]


def test_one_long_recording_is_judged_as_short_ones_are():
    """All torques and masses off alike explain everything, noise too, if only there are enough rows."""
    study = study_of([recorded(7, (0.05, 0.0), seconds=150.0)])
    verdict = judge(study).verdict
    (cause,) = verdict.causes
    assert (verdict.verdict, cause.effect, cause.where) == (VerdictKind.NAMED, "coulomb_friction", "shoulder")
    assert cause.value == pytest.approx(0.05, rel=0.02)
    explaining = {each.hypothesis.effect for each in study.fit.last.candidates if each.gain > 30.0}
    assert explaining <= {"torque_constant", "link_mass"}, "what is left is noise"


def test_recordings_without_equations_show_nothing():
    verdict = verdict_of([recorded(1, (0.3, 0.3), seconds=0.8)])
    assert verdict.verdict is VerdictKind.NOT_IDENTIFIABLE
    assert {"shoulder", "elbow"} <= set(" ".join(verdict.cannot_tell).replace(":", " ").split())


def constant(elbow_nm: float):
    """Two episodes with a constant torque at the elbow, which the catalogue lacks."""
    out = []
    for seed in (5, 6):
        position = motion(seed)
        torque, _ = torques_nm(position)
        out.append(recording(position, torque + np.array([0.0, elbow_nm]), seed))
    return out


def test_a_law_that_the_catalogue_lacks_is_unexplained_and_refused_hypotheses_are_no_rivals():
    verdict = verdict_of(constant(0.3))
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert any("elbow" in follows for follows in verdict.follows)
    assert all(rival.behind >= 0.0 for rival in verdict.rejected)
    assert verdict.runner_up is None or verdict.runner_up.behind >= 0.0


def test_refused_hypotheses_are_kept_apart_from_those_that_were_taken():
    fit = study_of(constant(0.3)).fit
    assert fit.refused
    assert not fit.refused & {(a.effect, a.where) for a in fit.accepted}


def test_a_joint_that_holds_still_is_not_stuck_but_was_not_judged():
    held = {"sizes": (0.0, 0.8), "offsets": (1.0, 0.0)}
    verdict = verdict_of([recorded(seed, **held) for seed in (1, 2)])
    assert verdict.verdict is VerdictKind.NOT_IDENTIFIABLE
    assert "shoulder could not" in verdict.summary
    assert any(sentence.startswith("anything about shoulder") for sentence in verdict.cannot_tell)
    found = verdict_of([recorded(seed, (0.0, 0.2), **held) for seed in (1, 2)])
    assert names_of(found.causes) == {("coulomb_friction", "elbow")}
    assert found.verdict is VerdictKind.NAMED


def test_a_joint_that_does_not_follow_its_target_is_stuck():
    recordings = []
    for seed in (1, 2):
        position = motion(seed, sizes=(0.0, 0.8))
        torque, velocity = torques_nm(position)
        target = position + np.stack([0.5 * np.sin(2 * np.pi * np.arange(len(position)) / 700), 0.0 * position[:, 1]], axis=1)
        pushed = torque + friction(velocity) + 5.0 * (target - position)
        recordings.append(recording(position, pushed, seed, position_target_rad=target))
    verdict = verdict_of(recordings)
    assert verdict.verdict is VerdictKind.NAMED
    assert names_of(verdict.causes) == {("stuck_joint", "shoulder")}


def test_what_one_recording_alone_shows_is_not_held_out():
    """The elbow moves in one of five recordings: without it nothing is known of its friction."""
    still = {"sizes": (0.8, 1e-6), "offsets": (0.0, 0.3), "seconds": 4.0}
    study = study_of([recorded(seed, (0.0, 0.3), **(still if seed else {"seconds": 4.0})) for seed in range(5)])
    assert study.fit.accepted == ()
    assert ("coulomb_friction", "elbow") in study.fit.refused
    assert judge(study).verdict.verdict is VerdictKind.UNEXPLAINED


def test_what_only_a_known_robot_shows_is_never_named():
    """Ends of joints, noise of torques and other encoders: what is usual for anybody's robot is not known."""
    position = motion(5, seconds=8.0)
    torque, velocity = torques_nm(position)
    late = np.roll(torque, 1, axis=0) + 0.05 * np.random.default_rng(1).standard_normal(torque.shape)
    encoder = np.round(position / [4e-4, 1e-4]) * [4e-4, 1e-4]
    made = recording(encoder, torque + friction(velocity, (0.2, 0.2)), 1, commanded_torque_nm=late)
    model = arm()
    model.jnt_limited[:] = True
    model.jnt_range[:] = np.stack([[-3.0, -3.0], np.max(position, axis=0) + 0.15], axis=1)  # where the motion turns short of
    verdict = judge(study_joints(model, [made], lambda *_: None, robot=UnknownRobot())).verdict
    assert names_of(verdict.causes) == {("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow")}
    assert any("ends of joints and noise of torques" in sentence for sentence in verdict.cannot_tell)
    assert any("measured torque" in sentence for sentence in verdict.cannot_tell)


def cart_pole(cart_n: float, size_m: float, told: float = 1.0) -> Verdict:
    """Of a cart that a force drives, some of which is lost to friction, and a pole that nothing drives; ``told`` for each m."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="cart" type="slide" axis="1 0 0"/><geom size=".05" mass="1" contype="0"/><body>'
        '<joint name="pole" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".01" mass=".2" contype="0"/></body>'
        "</body></worldbody></mujoco>"
    )
    rng, time_s, data = np.random.default_rng(3), np.arange(0.0, 10.0, STEP_S), mujoco.MjData(model)
    position, force = np.empty((len(time_s), 2)), np.zeros((len(time_s), 2))
    model.opt.timestep, model.dof_frictionloss[0] = STEP_S, cart_n
    for row, t in enumerate(time_s):
        position[row] = data.qpos
        target_m = size_m * np.sin(5.0 * t) + size_m * np.sin(2.3 * t)
        force[row, 0] = data.qfrc_applied[0] = 40.0 * (target_m - data.qpos[0]) - 4.0 * data.qvel[0]
        mujoco.mj_step(model, data)
    model.dof_frictionloss[0] = 0.0
    position += 1e-5 * rng.standard_normal(position.shape)
    position[:, 0] *= told
    joints = JointSignals(("cart", "pole"), position, commanded_torque_nm=force)
    slides, run = Slides.of(model, joints.names), Recording("run", "run.csv", STEP_S, time_s, joints)
    study = study_joints(slides.model_as_hinges(model), [slides.as_hinges(run)], lambda *_: None, robot=UnknownRobot())
    return reconsidered(study, Verdict(VerdictKind.NOTHING_WRONG, "", cannot_tell=tuple(untold(study, []))))


def test_what_is_left_at_a_slide_is_told_in_newtons_and_its_speed_in_metres():
    fast, slow = cart_pole(0.8, 0.05), cart_pole(0.0, 0.002)
    assert any(" N come from that the causes leave at cart" in said for said in fast.cannot_tell) or " N at cart" in fast.summary
    assert "anything that needs speed about cart: slower than 0.03 m/s all the time" in slow.cannot_tell


@pytest.mark.parametrize(("told", "unit"), [(1e3, "mm"), (1e2, "cm")])
def test_a_slide_that_is_read_in_another_unit_is_said(told, unit):
    verdict = cart_pole(0.1, 0.05, told)
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert verdict.misreads == f"the positions of cart are in {unit}, not in m"
