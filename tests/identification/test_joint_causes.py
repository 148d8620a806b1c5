"""Effects hidden in simulated robots are found by name, place and value; healthy robots stay silent; the truth is never read."""

from dataclasses import fields, replace

import numpy as np
import pytest

from sim_backend.reality_gap.bench.joint_cases import Case, draw_cases, recordings_of
from sim_backend.reality_gap.bench.joint_sessions import healthy_physics, simulated_sessions
from sim_backend.reality_gap.bench.joints import outcome, summary
from sim_backend.reality_gap.bench.many_causes import robot
from sim_backend.reality_gap.knowledge.healthy import detection_limits
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import ShowsNothingError, study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import VerdictKind
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import compile_scene

SEED = 4242  # no threshold was made with it
LIMITS = detection_limits()
HIDDEN = (
    "coulomb_friction.torque_nm",
    "action_delay.delay_s",
    "load_friction.coefficient",
    "encoder_offset.offset_rad",
    "cogging.amplitude_nm",
    "position_gain.factor",
)
ALSO_ELSEWHERE = tuple(key for key in HIDDEN if key != "position_gain.factor")
"""Effects that other tests hide, too, or whose law others compare with the driver's."""


def verdicts(cases, excluded=()):
    model = compile_scene()
    for case, recordings in zip(cases, recordings_of(cases), strict=True):
        study = study_joints(model, recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings), excluded=excluded)
        yield case, judge(study).verdict


def begin_of(recording, samples):
    signals = {f.name: getattr(recording.joints, f.name) for f in fields(recording.joints)}
    cut = {name: array[:samples] for name, array in signals.items() if isinstance(array, np.ndarray)}
    return replace(recording, time_s=recording.time_s[:samples], joints=replace(recording.joints, **cut))


def large(seed, keys, count):
    """Cases at five times the detection limit."""
    return [case for case in draw_cases(seed, 3 * len(keys), 0, LIMITS, keys) if case.multiple == 5.0][:count]


def test_every_effect_that_joints_show_has_a_detection_limit():
    assert set(AT_JOINTS) <= set(LIMITS)


@pytest.mark.parametrize("key", [pytest.param(key, marks=[pytest.mark.scale] * (key in ALSO_ELSEWHERE)) for key in HIDDEN])
def test_a_hidden_effect_is_named_with_place_and_value(key):
    """At scale with those that others name, too: `test_friction_of_all_joints_does_not_take_their_torques_along`,
    `test_a_cause_that_gains_far_more_does_not_hide_another` and `test_a_cause_at_the_elbow_is_named_with_its_value`; cogging and
    friction by load are held by `test_what_reaches_a_joint_is_what_the_driver_lets_through` and blind tests.
    """
    (case,) = (each for each in large(SEED, HIDDEN, len(HIDDEN)) if each.key == key)
    for _, verdict in verdicts([case]):
        assert verdict.verdict is VerdictKind.NAMED, (case, verdict)
        assert {(cause.effect, cause.where) for cause in verdict.causes} == {(case.effect, case.where)}, case
        cause = next(cause for cause in verdict.causes if cause.parameter == case.key.partition(".")[2])
        assert cause.value == pytest.approx(case.value, rel=0.15, abs=0.15 * LIMITS[case.key])


def study_of(seed, values):
    """A healthy robot with these values at every joint, seen by the standard excitation."""
    physics = healthy_physics(seed).changed({key: np.full((1, 9), value) for key, value in values.items()})
    recordings = simulated_sessions(physics, [seed])
    return study_joints(compile_scene(), recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))


def test_a_cause_that_gains_far_more_does_not_hide_another():
    verdict = judge(study_of(SEED + 60, {"action_delay.delay_s": 0.0025, "velocity_filter.time_constant_s": 0.0025})).verdict
    assert verdict.verdict is VerdictKind.NAMED
    assert {cause.effect for cause in verdict.causes} == {"action_delay", "velocity_filter"}


def test_friction_of_all_joints_does_not_take_their_torques_along():
    study = study_of(SEED + 61, {"coulomb_friction.torque_nm": 0.04})
    verdict = judge(study).verdict
    causes = verdict.causes
    assert {cause.effect for cause in causes} == {"coulomb_friction"}
    assert not any("backlash" in said for said in verdict.record_next)
    assert [cause.value for cause in causes] == pytest.approx([0.04] * 9, rel=0.06)
    before = [float(study.fit.last.state.value("coulomb_friction.torque_nm")[j]) for j in range(9)]
    assert min(before) < 0.93 * 0.04, "what the tolerances of a healthy robot would take of it"


def test_play_beside_other_causes_is_suspected_where_its_law_does_not_explain_it():
    recordings = simulated_sessions(robot(8341, 4), [8341])
    play = study_joints(compile_scene(), recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))
    verdict = judge(play).verdict
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert "backlash" in verdict.record_next[0]


@pytest.mark.scale
@pytest.mark.parametrize(("key", "value"), [("coulomb_friction.torque_nm", 0.05), ("load_friction.coefficient", 0.1)])
def test_play_is_not_suspected_where_all_joints_have_friction(key, value):
    """`test_friction_of_all_joints_does_not_take_their_torques_along` asks this of Coulomb friction."""
    assert not any("backlash" in said for said in judge(study_of(SEED + 63, {key: value})).verdict.record_next)


def test_play_in_all_gears_is_named_where_its_rotors_rattle():
    verdict = judge(study_of(SEED + 62, {"backlash.gap_rad": 0.003})).verdict
    assert verdict.verdict is VerdictKind.NAMED
    assert {cause.effect for cause in verdict.causes} == {"backlash"}
    named = {cause.where: cause for cause in verdict.causes}
    assert {name for name in c.JOINT_NAMES if name.endswith("middle_to_lower")} <= named.keys()
    assert sum(low <= 0.003 <= high for low, high in (cause.interval_90 for cause in named.values())) >= len(named) - 1


LOOSE = Case(0, SEED + 64, "backlash", "backlash.gap_rad", c.JOINT_NAMES[5], 5, 2.0, 0.0035)


def test_play_at_a_lower_joint_is_named_alone():
    for case, verdict in verdicts([LOOSE]):
        assert verdict.verdict is VerdictKind.NAMED
        (cause,) = verdict.causes
        assert (cause.effect, cause.where) == ("backlash", c.JOINT_NAMES[5])
        assert cause.interval_90[0] <= case.value <= cause.interval_90[1]
        assert verdict.null_p is None, "the gain of what was fitted would say nothing of it"


@pytest.mark.scale
def test_play_at_a_lower_joint_is_unexplained_without_its_effect():
    """`test_a_cause_that_the_catalogue_lacks_is_not_blamed_on_another_with_confidence` asks it of friction by load."""
    for _, verdict in verdicts([LOOSE], excluded=("backlash",)):
        assert verdict.verdict is VerdictKind.UNEXPLAINED
        assert any(c.JOINT_NAMES[5] in said for said in verdict.follows)


@pytest.mark.parametrize("number", [0, *(pytest.param(number, marks=pytest.mark.scale) for number in (1, 2, 3))])
def test_a_healthy_robot_is_not_blamed(number):
    """`test_a_healthy_robot_is_not_blamed` has one robot without scale."""
    for _, verdict in verdicts([Case(number, SEED + number)]):
        assert verdict.verdict is VerdictKind.NOTHING_WRONG
        assert not verdict.causes


@pytest.mark.parametrize("excitation", ["slow_ramps", pytest.param("fast_sweeps", marks=pytest.mark.scale)])
def test_healthy_robots_are_not_blamed_whatever_excites_them(excitation):
    """`test_healthy_robots_are_not_blamed_whatever_excites_them` has the slowest without scale."""
    recordings = simulated_sessions(healthy_physics(SEED), [SEED], excitation=excitation)
    verdict = judge(study_joints(compile_scene(), recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))).verdict
    assert verdict.verdict is VerdictKind.NOTHING_WRONG, verdict.summary


def test_an_encoder_of_a_trifinger_that_stands_still_now_and_then_is_told_whatever_else_explains_it():
    (healthy,) = simulated_sessions(healthy_physics(SEED), [SEED])
    joints, joint, rows = healthy.joints, 4, 40
    assert joints is not None and joints.velocity_rad_s is not None
    position, velocity = joints.position_rad.copy(), joints.velocity_rad_s.copy()
    speed = np.convolve(np.abs(np.diff(position[:, joint])), np.ones(rows), "valid")
    for begin in sorted(np.arange(2000, len(speed) - 2000, 2000), key=lambda at: -speed[at])[:8]:
        for reported in (position, velocity):
            reported[begin : begin + rows, joint] = reported[begin, joint]
    recordings = (replace(healthy, joints=replace(joints, position_rad=position, velocity_rad_s=velocity)),)
    verdict = judge(study_joints(compile_scene(), recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))).verdict
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert f"the encoder of {c.JOINT_NAMES[joint]} stood still" in verdict.summary


def test_a_cause_that_the_catalogue_lacks_is_not_blamed_on_another_with_confidence():
    case = Case(0, SEED, "load_friction", "load_friction.coefficient", c.JOINT_NAMES[1], 1, 5.0, 0.15)
    for _, verdict in verdicts([case], excluded=("load_friction",)):
        assert verdict.verdict is VerdictKind.UNEXPLAINED
        assert any(c.JOINT_NAMES[1] in sentence for sentence in verdict.follows)


def test_a_robot_at_rest_tells_nothing():
    rng, steps = np.random.default_rng(SEED), 20_000
    position = np.tile(c.START_JOINT_POSITION_RAD, (steps, 1)) + 5e-5 * rng.standard_normal((steps, 9))
    joints = JointSignals(c.JOINT_NAMES, position, np.zeros((steps, 9)), np.zeros((steps, 9)), np.zeros((steps, 9)))
    rest = Recording("rest", "rest.mcap", 1e-3, 1e-3 * np.arange(steps), joints)
    with pytest.raises(ShowsNothingError, match="no joint moves"):
        study_joints(compile_scene(), [rest], lambda *_: None, robot=KnownTriFinger.seen_in([rest]))


def test_short_pieces_of_a_recording_tell_nothing():
    (whole,) = simulated_sessions(healthy_physics(SEED), [SEED], excitation="oscillations")
    for pieces in ([begin_of(whole, 9000)] * 3, [begin_of(whole, 17_000)]):
        with pytest.raises(ShowsNothingError, match=r"last (0|17).0 s in all, and it takes 18 s"):
            study_joints(compile_scene(), pieces, lambda *_: None, robot=KnownTriFinger.seen_in(pieces))


def test_the_blind_test_counts_what_was_said():
    def line(kind, causes, *, effect="coulomb_friction", multiple=2.0, left_out=False):
        case = Case(0, 0, effect, f"{effect}.torque_nm" if effect else "", "a" if effect else "", 0, multiple, 0.02).document()
        numbers = {hidden.effect: hidden.key.partition(".")[2] for hidden in AT_JOINTS.values()}
        said = [
            {"effect": e, "where": w, "parameter": numbers[e], "value": 0.021, "interval_90": [0.02, 0.022]} for e, w in causes
        ]
        return {"case": case, "left_out": left_out, "verdict": {"verdict": kind, "causes": said}, "naive": {}, "seconds": 1.0}

    lines = [
        line("named", [("coulomb_friction", "a")]),
        line("named", [("coulomb_friction", "a"), ("backlash", "a")]),
        line("named", [("viscous_friction", "a")]),
        line("confusable", [("coulomb_friction", "a"), ("backlash", "a")]),
        line("nothing_wrong", [], effect=""),
        line("named", [("backlash", "b")], effect=""),
        line("unexplained", [], left_out=True),
    ]
    assert [outcome(x) for x in lines[:4]] == ["right", "extra", "wrong", "right set"]
    counted = summary(lines)
    assert (counted["n_effect"], counted["n_null"], counted["n_left_out"]) == (4, 2, 1)
    assert (counted["right_name"]["k"], counted["wrong_name"]["k"], counted["false_alarm"]["k"]) == (1, 1, 1)
    assert counted["unexplained"]["rate"] == 1.0
    assert counted["median_parameter_error"] == pytest.approx(0.05)
