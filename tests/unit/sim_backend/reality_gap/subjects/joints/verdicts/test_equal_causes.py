"""Causes that are the same numbers are said together, with what tells them apart."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.subjects.joints.laws.body_law import tilted_gravity
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.verdicts.equal_causes import (
    with_late_columns,
    with_share_of_all,
    with_turned_base,
    with_weight,
)
from sim_backend.reality_gap.verdict import Cause, EffectJudged, Rival, Told, Verdict, VerdictKind


def masses(*factors: tuple[str, float]) -> Verdict:
    causes = tuple(Cause("link_mass", "factor", name, value, "1", (value - 0.03, value + 0.03)) for name, value in factors)
    return Verdict(verdict=VerdictKind.NAMED, summary="Masses.", causes=causes)


TOLERATED = 0.02


def constants(*errors: tuple[str, float]) -> Verdict:
    causes = tuple(Cause("torque_constant", "error", name, by, "1", (by - 0.005, by + 0.005)) for name, by in errors)
    return Verdict(verdict=VerdictKind.NAMED, summary="Motors.", causes=causes)


def test_all_masses_by_one_share_may_be_all_torques():
    found = with_share_of_all(masses(("upper", 0.75), ("lower", 0.74)), ("upper", "lower"), (True, True), TOLERATED)
    assert found.verdict is VerdictKind.CONFUSABLE and found.record_next
    errors = {cause.where: cause.value for cause in found.causes if cause.effect == "torque_constant"}
    assert errors == {"upper": pytest.approx(1 / 0.75 - 1), "lower": pytest.approx(1 / 0.74 - 1)}


@pytest.mark.parametrize(("factor", "is_asked"), [(0.58, False), (0.75, True), (2.5, False)])
def test_the_mass_of_a_single_link_may_be_its_torque_where_rollouts_could_not_ask(factor, is_asked):
    found = with_share_of_all(masses(("upper", factor)), ("upper",), (True,), TOLERATED)
    assert (found.verdict is VerdictKind.NAMED) is is_asked
    assert [cause.value for cause in found.causes[1:]] == ([] if is_asked else [pytest.approx(1 / factor - 1)])


def test_poses_are_not_said_to_tell_a_single_link_from_its_motor():
    pose = separated_by("link_mass", "torque_constant", "")
    both, rival = masses(("upper", 1.2)).causes + constants(("upper", -0.17)).causes, Rival("torque_constant", "upper", 0.1, pose)
    more = {"runner_up": rival, "rejected": (rival,), "record_next": (pose, "slowly")}
    open_ = Verdict(VerdictKind.CONFUSABLE, "Either.", causes=both, **more)
    found = with_share_of_all(open_, ("upper",), (True,), TOLERATED)
    assert found.runner_up is not None and found.runner_up == found.rejected[0]
    assert "payload of known mass" in found.runner_up.separated_by and "payload of known mass" in found.record_next[0]
    assert found.record_next[1] == "slowly" and found.causes == both
    assert with_share_of_all(open_, ("upper", "lower"), (True, True), TOLERATED) == open_


@pytest.mark.parametrize("factors", [(("upper", 0.75),), (("upper", 0.75), ("lower", 0.9))])
def test_masses_that_are_off_each_by_its_own_are_named(factors):
    assert with_share_of_all(masses(*factors), ("upper", "lower"), (True, True), TOLERATED).verdict is VerdictKind.NAMED


def test_the_only_motor_of_an_arm_that_is_too_weak_may_be_all_masses_also_of_links_that_nothing_drives():
    found = with_share_of_all(constants(("cart", -0.2)), ("cart", "pole"), (True, False), TOLERATED)
    assert found.verdict is VerdictKind.CONFUSABLE
    assert {c.where: c.value for c in found.causes if c.effect == "link_mass"} == {
        "cart": pytest.approx(1.25),
        "pole": pytest.approx(1.25),
    }


def test_masses_of_all_links_may_be_the_only_motor():
    found = with_share_of_all(masses(("cart", 1.25), ("pole", 1.25)), ("cart", "pole"), (True, False), TOLERATED)
    assert {c.where: c.value for c in found.causes if c.effect == "torque_constant"} == {"cart": pytest.approx(-0.2)}


@pytest.mark.parametrize(("error", "is_named"), [(-0.185, False), (-0.15, True)])
def test_shares_may_differ_by_what_masses_may_be_off(error, is_named):
    found = with_share_of_all(constants(("a", -0.2), ("b", error)), ("a", "b"), (True, True), TOLERATED)
    assert (found.verdict is VerdictKind.NAMED) is is_named
    assert len(found.causes) == (2 if is_named else 4)
    assert all(low < cause.value < high for cause in found.causes for low, high in [cause.interval_90])


@pytest.mark.parametrize("joints", [("lower",), ("upper", "lower")])
def test_a_delay_that_motions_alone_tell_may_be_late_positions(joints):
    delays = [Cause("action_delay", "delay_s", name, 0.008, "s", (0.007, 0.009)) for name in joints]
    judged = (EffectJudged("action_delay", Told.NAMED), EffectJudged("gravity", Told.EXCLUDED, 0.1, "m/s^2"))
    found = with_late_columns(Verdict(VerdictKind.NAMED, "A delay.", causes=tuple(delays), effects=judged))
    assert found.verdict is VerdictKind.CONFUSABLE and found.causes == tuple(delays)
    assert "written 8" in found.summary and any("current" in said for said in found.record_next)
    assert [each.told for each in found.effects] == [Told.CONFUSABLE, Told.EXCLUDED]


def test_causes_without_a_delay_stay_named():
    verdict = masses(("upper", 0.75))
    assert with_late_columns(verdict) == verdict


ARM = """
<mujoco><worldbody>
 <body name="upper"><joint name="shoulder" axis="{axis}"/>
  <inertial pos="0.1 0 -0.2" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
  <body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="1 1 0"/>
   <inertial pos="0 0.05 -0.2" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/></body></body>{more}
</worldbody></mujoco>
"""
WEIGHTLESS = '<option gravity="0 0 0"/><worldbody>'
NAMES = ("shoulder", "elbow")
OFFSET_RAD = 0.1
ENCODER = Cause("encoder_offset", "offset_rad", "shoulder", OFFSET_RAD, "rad", (0.09, 0.11))


def arm(axis: str = "0 1 0", more: str = "") -> Plant:
    return Plant(mujoco.MjModel.from_xml_string(ARM.format(axis=axis, more=more)), NAMES)


def turned_gravity(plant: Plant) -> np.ndarray:
    """That makes of reported positions the torques that the true ones need, of an encoder that says too much."""
    true_rad, rest = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2)), np.zeros((50, 2))
    needed = plant.torque_nm(true_rad, rest, rest)
    by_gravity = plant.derivatives(true_rad + np.array([OFFSET_RAD, 0.0]), rest, rest).by_gravity
    return np.linalg.lstsq(by_gravity.reshape(-1, 3), needed.ravel(), rcond=None)[0]


def with_gravity(plant: Plant, now: np.ndarray) -> tuple[Verdict, JointState]:
    by = now - plant.gravity_m_s2
    causes = [Cause("gravity", "offset_m_s2", "xyz"[i], by[i], "m/s^2", (by[i] - 0.05, by[i] + 0.05)) for i in (0, 2)]
    judged = (EffectJudged("gravity", Told.NAMED), EffectJudged("encoder_offset", Told.EXCLUDED, 1e-3, "rad"))
    return Verdict(VerdictKind.NAMED, "Gravity.", causes=tuple(causes), effects=judged), JointState(
        2, {"gravity.offset_m_s2": by}
    )


def test_a_robot_that_nothing_pulls_is_a_table_of_torques_without_gravity():
    plant = arm()
    verdict, state = with_gravity(plant, np.array([0.0, 0.0, -0.3]))
    friction = Cause("coulomb_friction", "torque_nm", "elbow", 0.1, "N m", (0.09, 0.11))
    found = with_weight(replace(verdict, causes=(*verdict.causes, friction)), plant, state)
    assert found.verdict is VerdictKind.UNEXPLAINED and found.causes == (friction,)
    assert "without its share" in found.misreads and all(each.told is Told.NOT_JUDGED for each in found.effects)
    verdict, state = with_gravity(plant, np.array([0.0, 0.0, -9.5]))
    assert with_weight(verdict, plant, state) == verdict


def test_a_robot_of_which_most_weight_is_held_up_may_have_a_controller_that_does_so():
    plant = arm()
    verdict, state = with_gravity(plant, np.array([0.0, 0.0, -3.8]))
    found = with_weight(verdict, plant, state)
    assert found.verdict is VerdictKind.CONFUSABLE and found.causes == verdict.causes
    assert "holds up 61% of the weight" in found.summary and "measured" in found.record_next[0]
    assert [each.told for each in found.effects] == [Told.CONFUSABLE, Told.EXCLUDED]


def test_gravity_that_is_turned_about_the_first_axis_may_be_the_encoder_there():
    plant = arm()
    verdict, state = with_gravity(plant, turned_gravity(plant))
    found = with_turned_base(verdict, plant, state)
    assert found.verdict is VerdictKind.CONFUSABLE and "two poses" in found.record_next[0]
    (encoder,) = [cause for cause in found.causes if cause.effect == "encoder_offset"]
    assert (encoder.where, encoder.unit) == ("shoulder", "rad")
    assert encoder.value == pytest.approx(OFFSET_RAD, abs=1e-6)
    assert encoder.interval_90[0] < OFFSET_RAD < encoder.interval_90[1] < 0.12
    assert [each.told for each in found.effects] == [Told.CONFUSABLE, Told.CONFUSABLE]


def test_an_encoder_of_the_first_joint_may_be_a_base_that_is_turned():
    plant = arm()
    found = with_turned_base(Verdict(VerdictKind.NAMED, "An encoder.", causes=(ENCODER,)), plant, JointState(2))
    tilts = {cause.parameter: cause.value for cause in found.causes if cause.effect == "table_tilt"}
    assert found.verdict is VerdictKind.CONFUSABLE and set(tilts) == {"pitch_rad"}
    np.testing.assert_allclose(tilted_gravity(plant.gravity_m_s2, 0.0, tilts["pitch_rad"]), turned_gravity(plant), atol=1e-4)


def test_an_encoder_about_a_slanting_axis_is_a_tilt_both_ways_however_uncertain():
    uncertain = replace(ENCODER, interval_90=(0.01, 0.19))
    found = with_turned_base(Verdict(VerdictKind.NAMED, "An encoder.", causes=(uncertain,)), arm("1 1 0"), JointState(2))
    tilts = {cause.parameter: cause.value for cause in found.causes if cause.effect == "table_tilt"}
    assert found.verdict is VerdictKind.CONFUSABLE and set(tilts) == {"roll_rad", "pitch_rad"}
    assert np.hypot(*tilts.values()) == pytest.approx(OFFSET_RAD, rel=0.02)


def test_without_gravity_nothing_turns_it():
    plant = Plant(mujoco.MjModel.from_xml_string(ARM.format(axis="0 1 0", more="").replace("<worldbody>", WEIGHTLESS)), NAMES)
    verdict = Verdict(VerdictKind.NAMED, "An encoder.", causes=(ENCODER,))
    assert with_turned_base(verdict, plant, JointState(2)) == verdict


@pytest.mark.parametrize(
    ("axis", "more", "by"),
    [
        ("0 1 0", "", [1.0, 0.0, 1.0]),  # another strength
        ("0 1 0", "", [0.0, 1.0, 0.05]),  # about another axis
        ("0 0 1", "", [1.0, 0.0, 0.05]),  # nothing turns about gravity's own
        ("0 1 0", '<body><joint name="other"/><geom size="0.1"/></body>', [1.0, 0.0, 0.05]),  # something else would turn, too
    ],
)
def test_gravity_that_is_no_turn_about_the_first_axis_stays_as_it_is(axis, more, by):
    plant = arm(axis, more)
    verdict, state = with_gravity(plant, plant.gravity_m_s2 + by)
    assert with_turned_base(verdict, plant, state) == verdict


def test_encoders_of_other_joints_and_of_one_about_a_vertical_axis_stay_named():
    elbow = Verdict(
        VerdictKind.NAMED, "An encoder.", causes=(Cause("encoder_offset", "offset_rad", "elbow", 0.1, "rad", (0.09, 0.11)),)
    )
    assert with_turned_base(elbow, arm(), JointState(2)) == elbow
    shoulder = Verdict(VerdictKind.NAMED, "An encoder.", causes=(ENCODER,))
    assert with_turned_base(shoulder, arm("0 0 1"), JointState(2)) == shoulder
