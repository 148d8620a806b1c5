"""What is said where torques and simulated motions are asked together."""

from dataclasses import replace

import pytest

from sim_backend.reality_gap.subjects.joints.verdicts.torques_and_rollouts import in_both, of_smoothed
from sim_backend.reality_gap.verdict import Cause, Doubt, EffectJudged, Told, Verdict, VerdictKind

FRICTION = Cause("coulomb_friction", "torque_nm", "elbow", 0.1, "N m", (0.08, 0.12))
DELAY = Cause("action_delay", "delay_s", "elbow", 0.01, "s", (0.008, 0.012))
NOISE = Cause("joint_noise", "position_rad", "elbow", 1e-3, "rad", (9e-4, 1.1e-3))
FILTER = Cause("velocity_filter", "time_constant_s", "elbow", 0.012, "s", (0.011, 0.013))
JUDGED = (EffectJudged("gravity", Told.EXCLUDED, 0.1, "m/s^2"),)


def verdict(kind: VerdictKind, *causes: Cause, **more) -> Verdict:
    return Verdict(kind, f"It is {kind.value}.", causes=causes, **more)


def test_a_cause_that_does_not_roll_out_is_not_named_but_told():
    torques = verdict(VerdictKind.NAMED, DELAY, FRICTION)
    found = in_both(torques, verdict(VerdictKind.NAMED, FRICTION, effects=JUDGED))
    assert found.causes == (FRICTION,) and found.effects == JUDGED
    assert any("action delay" in said for said in found.cannot_tell)
    assert not any("coulomb" in said for said in found.cannot_tell)


@pytest.mark.parametrize(("torques", "columns", "seen"), [((NOISE,), (), NOISE), ((FILTER,), (FILTER,), FILTER)])
def test_what_sensors_show_is_named_beside_a_motion_that_agrees(torques, columns, seen):
    found = in_both(verdict(VerdictKind.NAMED, *torques), verdict(VerdictKind.NOTHING_WRONG), columns)
    assert found.verdict is VerdictKind.NAMED and found.causes == (seen,)
    assert seen.effect.replace("_", " ") in found.summary


def test_a_filter_is_what_both_columns_say_whatever_torques_do():
    nothing = verdict(VerdictKind.NOTHING_WRONG)
    assert in_both(verdict(VerdictKind.UNEXPLAINED), nothing, (FILTER,)).causes == (FILTER,)
    assert in_both(verdict(VerdictKind.NAMED, FILTER), nothing).causes == ()


def test_what_sensors_show_does_not_explain_a_motion():
    found = in_both(verdict(VerdictKind.NAMED, NOISE), verdict(VerdictKind.UNEXPLAINED))
    assert found.verdict is VerdictKind.UNEXPLAINED and found.summary == "It is unexplained."


def test_what_motors_show_is_named_only_where_the_motion_agrees():
    judged = (EffectJudged(DELAY.effect, Told.EXCLUDED, 0.01, "s"),)
    agrees = in_both(verdict(VerdictKind.NOTHING_WRONG), verdict(VerdictKind.NOTHING_WRONG, effects=judged), [DELAY])
    assert agrees.verdict is VerdictKind.NAMED and agrees.causes == (DELAY,) and agrees.effects[0].told is Told.NAMED
    does_not = in_both(verdict(VerdictKind.NOTHING_WRONG), verdict(VerdictKind.UNEXPLAINED, effects=judged), [DELAY])
    assert does_not.verdict is VerdictKind.UNEXPLAINED and does_not.effects[0].told is Told.NOT_JUDGED


@pytest.mark.parametrize(
    ("smoothed", "kind"),
    [
        ({"elbow": (0.06, 0.0)}, VerdictKind.CONFUSABLE),
        ({"elbow": (0.03, 9.0)}, VerdictKind.NAMED),
        ({"wrist": (9.0, 9.0)}, VerdictKind.NAMED),
    ],
    ids=["as much", "more than lateness makes", "another joint's"],
)
def test_damping_beside_a_current_behind_a_filter_may_be_a_column_that_is_late(smoothed, kind):
    damping = replace(FRICTION, effect="viscous_friction", parameter="damping_nm_s_rad")
    doubts = of_smoothed((damping, FRICTION), smoothed, lambda _: 0.0)
    found = in_both(verdict(VerdictKind.NAMED), verdict(VerdictKind.NAMED, damping, FRICTION), (), doubts)
    assert found.verdict is kind and found.causes == (damping, FRICTION)
    assert ("smoothed by its sensor" in found.summary) is (kind is VerdictKind.CONFUSABLE)


@pytest.mark.parametrize(
    ("kind", "told"),
    [(VerdictKind.UNEXPLAINED, VerdictKind.UNEXPLAINED), (VerdictKind.NOTHING_WRONG, VerdictKind.NOT_IDENTIFIABLE)],
)
def test_rows_too_few_for_torques_show_that_a_model_goes_elsewhere(kind, told):
    few = verdict(VerdictKind.NOT_IDENTIFIABLE, record_next=("longer",))
    found = in_both(few, verdict(kind, record_next=("slowly",), effects=JUDGED))
    assert found.verdict is told and found.record_next[0] == "longer"
    assert ("It is unexplained." in found.summary) is (kind is VerdictKind.UNEXPLAINED)


def test_what_may_be_no_fault_is_not_named_for_sure():
    doubt = Doubt(DELAY, "the measured torque of elbow is smoothed", "steps of torque")
    judged = (EffectJudged(DELAY.effect, Told.EXCLUDED, 0.01, "s"), EffectJudged(NOISE.effect, Told.EXCLUDED, 1e-3, "rad"))
    found = in_both(verdict(VerdictKind.NAMED, NOISE), verdict(VerdictKind.NOTHING_WRONG, effects=judged), [DELAY], [doubt])
    assert found.verdict is VerdictKind.CONFUSABLE and found.causes == (NOISE, DELAY)
    assert "is smoothed" in found.summary and "steps of torque" in found.record_next
    assert [each.told for each in found.effects] == [Told.CONFUSABLE, Told.NAMED]
    unasked = in_both(verdict(VerdictKind.NAMED, NOISE), verdict(VerdictKind.NOTHING_WRONG, effects=judged), (), [doubt])
    assert unasked.verdict is VerdictKind.NAMED and unasked.record_next == ()


def test_a_reading_that_simulated_motions_give_leaves_nothing_to_doubt():
    said = replace(verdict(VerdictKind.UNEXPLAINED, follows=("gravity",)), misreads="gravity takes no torque")
    gravity = Cause("gravity", "offset_m_s2", "z", 9.8, "m/s^2", (9.7, 9.9))
    found = in_both(verdict(VerdictKind.NAMED, gravity), said)
    assert found.verdict is VerdictKind.UNEXPLAINED and found.follows == ("gravity",) and not found.cannot_tell


def test_units_that_are_not_as_told_come_first():
    torques = replace(verdict(VerdictKind.UNEXPLAINED), misreads="the positions are in degrees")
    assert in_both(torques, verdict(VerdictKind.NAMED, FRICTION)).causes == ()


def test_recordings_that_show_nothing_stay_so():
    found = in_both(verdict(VerdictKind.NOT_IDENTIFIABLE), verdict(VerdictKind.NOTHING_WRONG))
    assert found.verdict is VerdictKind.NOT_IDENTIFIABLE
