"""What may be wrong with joints."""

import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge.healthy import HealthySessions, healthy_tolerances
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS
from sim_backend.reality_gap.knowledge.joint_effects import SCALES
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import (
    ALL_JOINTS,
    CLOCK_TOLERANCE,
    PLATFORM,
    joint_catalogue,
    without_play,
)
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, SENSED, JointState
from sim_backend.trifinger import constants as c

CHECKED = {"encoder_quantisation", "joint_noise", "action_noise", "stuck_joint", "encoder_jump", "joint_limits"}
"""Effects that ``joint_checks`` finds without a fit."""
STATE = JointState(9, {"torque_saturation.limit_nm": np.full(9, c.MAX_TORQUE_NM)})
LOAD_NM = np.tile(np.linspace(-0.3, 0.3, 50)[:, None], (1, 9))


def catalogue(robot=None, tolerances=None, state=STATE, load_nm=LOAD_NM):
    known = robot or KnownTriFinger(HealthySessions(tolerances or {}, np.zeros(0), {}))
    return joint_catalogue(c.JOINT_NAMES, state, load_nm, 1e-3, robot=known)


@pytest.fixture(scope="module")
def whole():
    return catalogue()


@pytest.mark.parametrize("given", ["a rise and a time constant of one joint", "a loss that was taken at one joint"])
def test_what_is_known_of_one_motor_leaves_all_shapes_of_all_motors_together(whole, given):
    key, joint = "thermal_derating.{}".format, 2
    if given.startswith("a rise"):
        start = state = STATE.with_values({(key("rise_k_nm2"), joint): 7.0, (key("time_constant_s"), joint): 60.0})
    else:
        start, taken = STATE, {(key("loss_per_k"), joint): 0.01, (key("rise_k_nm2"), joint): 2000.0}
        state = STATE.with_values(taken | {(key("time_constant_s"), joint): 5.0})
    known = KnownTriFinger(HealthySessions({}, np.zeros(0), {}))
    found = joint_catalogue(c.JOINT_NAMES, state, LOAD_NM, 1e-3, robot=known, start=start)

    def shapes(catalogue, where):
        heat = [h for h in catalogue.hypotheses if (h.effect, h.where) == ("thermal_derating", where)]
        return [[dict(catalogue.terms[i].shape) for i in h.terms] for h in heat]

    assert len(shapes(found, ALL_JOINTS)) == len(shapes(whole, ALL_JOINTS)) > 1
    own = {tuple(sorted(shape.items())) for each in shapes(found, c.JOINT_NAMES[joint]) for shape in each}
    if given.startswith("a rise"):
        assert own == {((key("rise_k_nm2"), 7.0), (key("time_constant_s"), 60.0))}
    else:
        assert len(own) == len(shapes(whole, c.JOINT_NAMES[joint])), "what was taken says nothing of how it looks"


def test_every_effect_that_joints_show_is_a_hypothesis_or_a_check(whole):
    shown = {key.partition(".")[0] for key in AT_JOINTS}
    asked = {h.effect for h in whole.hypotheses}
    assert asked | CHECKED == shown
    assert not asked & CHECKED
    assert {effect for effect in CHECKED} <= set(CATALOGUE)


def test_terms_are_numbers_of_the_catalogue_with_a_probe_and_a_scale(whole):
    for term in whole.terms:
        if term.key in (CLOCK, SENSED):
            continue
        assert term.key in PARAMETERS
        assert SCALES[term.key] > 0.0
        assert term.probe != 0.0
        assert all(key in PARAMETERS for key, _ in term.shape)
        assert 0 <= term.index < STATE.width(term.key)


def test_hypotheses_name_a_joint_all_joints_or_the_platform(whole):
    for h in whole.hypotheses:
        assert h.where in (*c.JOINT_NAMES, ALL_JOINTS, PLATFORM)
        assert len(h.terms) == len(h.scales)
        effects = {whole.terms[t].effect for t in h.terms}
        assert effects == {h.effect}
        joints = {whole.terms[t].index for t in h.terms}
        if h.where == ALL_JOINTS:
            assert joints == set(range(9))
        elif h.where != PLATFORM:
            assert joints == {c.JOINT_NAMES.index(h.where)}
    named = [h for h in whole.hypotheses if h.effect == "coulomb_friction"]
    assert [h.where for h in named] == [*c.JOINT_NAMES, ALL_JOINTS]


def test_scales_of_everything_are_only_asked_of_single_joints(whole):
    for effect in ("torque_constant", "link_mass"):
        assert {h.where for h in whole.hypotheses if h.effect == effect} == set(c.JOINT_NAMES)


def test_saturation_is_only_asked_where_torques_reach(whole):
    levels = {c.MAX_TORQUE_NM + t.probe for t in whole.terms if t.key == "torque_saturation.limit_nm" and t.index == 0}
    assert sorted(levels) == pytest.approx([0.3 * share for share in (0.3, 0.5, 0.7, 0.85, 0.95)])


def test_tolerances_are_of_healthy_robots_or_of_healthy_sessions():
    healthy = healthy_tolerances()
    given = {"backlash.gap_rad": [1e-3, 2e-3, 3e-3], "coulomb_friction.torque_nm": [1.0], "link_mass.factor": [1.0]}
    found = catalogue(tolerances=given)
    by_key = {}
    for term, tolerance in zip(found.terms, found.tolerance, strict=True):
        if term.index == 0:
            by_key.setdefault(term.key, []).append(float(tolerance))
    assert by_key["backlash.gap_rad"] == [1e-3, 2e-3, 3e-3]
    assert by_key["coulomb_friction.torque_nm"] == [1.0]
    assert by_key["link_mass.factor"] == [healthy.get("link_mass.factor", 0.0)]
    assert by_key[CLOCK] == [CLOCK_TOLERANCE * 1e-3]
    assert by_key[SENSED] == [1.0]
    for key, value in healthy.items():
        if key in by_key and key not in given:
            assert by_key[key][0] == value
            assert set(by_key[key][1:]) <= {0.0, value}  # of several shapes one; of pairs both


def test_what_needs_the_safety_pipeline_is_not_asked_without_it():
    asked = {h.effect for h in catalogue(robot=UnknownRobot()).hypotheses}
    left_out = {"position_gain", "safety_damping", "timing_jitter", "controller_restart", "supply_sag"}
    assert {h.effect for h in catalogue().hypotheses} - asked == left_out


def test_an_effect_left_out_is_neither_asked_nor_tolerated(whole):
    less = whole.without(("viscous_friction",))
    assert whole.terms == less.terms
    assert "viscous_friction" not in {h.effect for h in less.hypotheses}
    assert not any(less.tolerance[i] for i, t in enumerate(less.terms) if t.effect == "viscous_friction")
    assert len(less.hypotheses) == len(whole.hypotheses) - 10


def test_what_differs_between_directions_is_probed_by_the_friction_of_its_joint():
    friction = np.linspace(0.01, 0.09, 9)
    state = JointState(9, {"coulomb_friction.torque_nm": friction}, size=30.0)
    unknown, known = (
        [t.probe for t in catalogue(robot, state=state).terms if t.key == "directional_friction.difference_nm"]
        for robot in (UnknownRobot(), None)
    )
    assert unknown == pytest.approx(np.stack([-friction / 3, friction / 3], axis=1).ravel())
    assert {abs(probe) for probe in known} == {0.3}


def test_a_joint_without_a_rotor_has_no_play(whole):
    def places(of):
        return [h.where for h in of.hypotheses if h.effect == "backlash"]

    assert set(places(without_play(whole, np.arange(9) > 0))) == set(c.JOINT_NAMES[1:])
    assert places(without_play(whole, np.ones(9, bool))) == places(whole)
    assert places(without_play(whole, np.zeros(9, bool))) == []


@pytest.mark.parametrize("mean_nm", [0.005, 20.0])
def test_a_motor_of_any_size_gets_as_hot_from_what_it_is_sent_in_the_mean(mean_nm):
    """One that is sent much for a moment only gets hot from less."""
    load_nm = mean_nm * LOAD_NM / np.sqrt((LOAD_NM**2).mean(axis=0))
    load_nm[0] *= 10.0
    load_nm /= np.sqrt((load_nm**2).mean(axis=0)) / mean_nm
    unknown = JointState(9, {"torque_saturation.limit_nm": np.full(9, 1e9)}, size=150.0)  # of its largest motor
    for robot, state, hot_k in (
        (UnknownRobot(), unknown, 2000.0 * 0.24**2),
        (None, STATE, 2000.0 * mean_nm**2),
    ):
        terms = [t for t in catalogue(robot, state=state, load_nm=load_nm).terms if t.effect == "thermal_derating"]
        assert terms and all(dict(t.shape)["thermal_derating.rise_k_nm2"] * mean_nm**2 == pytest.approx(hot_k) for t in terms)


@pytest.mark.parametrize(("effect", "numbers"), [("gravity", 3), ("table_tilt", 2)])
def test_of_a_known_robot_each_number_of_the_platform_is_asked_alone_too(effect, numbers):
    """Numbers that the data do not need take a part of what a hypothesis gains: a tilt one way, gravity of another strength."""
    own, elsewhere = ([h for h in catalogue(robot).hypotheses if h.effect == effect] for robot in (None, UnknownRobot()))
    assert [(len(h.terms), h.is_part) for h in elsewhere] == [(numbers, False)]
    (whole,) = [h for h in own if not h.is_part]
    assert sorted(h.terms for h in own if h.is_part) == sorted((term,) for term in whole.terms) and len(whole.terms) == numbers
