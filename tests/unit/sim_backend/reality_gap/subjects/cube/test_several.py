"""Several causes at a cube, on pushes that are made up: each effect moves them in its own way, by its factor's logarithm."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.cube import TRIALS
from sim_backend.reality_gap.subjects.cube.healthy import cubes_of_many, load_calibration
from sim_backend.reality_gap.subjects.cube.replay import Replayed
from sim_backend.reality_gap.subjects.cube.replayed_robot import NOMINAL_ROBOT, ReplayedRobot
from sim_backend.reality_gap.subjects.cube.several import Scatter, Several, one_after_the_other
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.reality_gap.subjects.cube.verdict_of_several import verdict_of_several
from sim_backend.reality_gap.verdict import VerdictKind

CALIBRATION = load_calibration()
OF_MANY = cubes_of_many(CALIBRATION.null)
TRACKER = TrackerStatistics(500, 0.1, 0.09, 0.003, 1, 1, 0, 450, 0.0324, 0.001, 0.0115, 0.916)
LATE = TrackerStatistics(500, 0.1, 0.12, 0.003, 1, 1, 0, 450, 0.0324, 0.001, 0.0115, 0.916)
SIZE, PUSHES = 240, 6
FACTORS = ("cube_mass", "table_friction", "fingertip_friction", "cube_size")
_RNG = np.random.default_rng(7)
WAYS = {effect: 3.0 * _RNG.normal(size=SIZE) for effect in FACTORS} | {
    name: 300.0 * _RNG.normal(size=SIZE) for name in ("tracking_offset_x", "tracking_offset_y", "tracking_scale")
}


def pushes_of(true: dict[str, float], tracker: TrackerStatistics = TRACKER) -> Callable[[ReplayedRobot], CubeEvidence]:
    """Replays of a robot whose cube differs by some factors, with any base."""
    channel, time_s = np.arange(SIZE) % 6, np.linspace(0.0, 0.66, SIZE)

    def evidence_with(base: ReplayedRobot) -> CubeEvidence:
        seen = sum((np.log(true.get(e, 1.0) / base.values(e)[0]) * WAYS[e] for e in FACTORS), np.zeros(SIZE))
        seen -= base.bias_m[0] * WAYS["tracking_offset_x"] + base.bias_m[1] * WAYS["tracking_offset_y"]
        seen -= base.scale * WAYS["tracking_scale"]
        moved = [np.log(t.value) * WAYS[t.effect] if t.effect in FACTORS else t.value * WAYS[t.effect] for t in TRIALS[1:]]
        residual = seen - np.stack([np.zeros(SIZE), *moved])
        return CubeEvidence(tracker, (Replayed(residual, channel, time_s),) * PUSHES, base.rest_height_m)

    return evidence_with


def found_in(evidence_with: Callable[[ReplayedRobot], CubeEvidence]) -> Several:
    scatter = Scatter(CALIBRATION.null, OF_MANY.null)
    return one_after_the_other(evidence_with, NOMINAL_ROBOT, scatter, lambda gain: gain > 10.0)


def test_two_causes_that_act_at_once_are_both_found_with_their_numbers():
    found = found_in(pushes_of({"table_friction": 0.4, "cube_mass": 0.7}))
    values = {row.effect: row.value for row in found.estimates}
    assert values == {"table_friction": pytest.approx(0.4, abs=0.03), "cube_mass": pytest.approx(0.7, abs=0.05)}
    assert all(0.0 < row.std < 0.1 for row in found.estimates)
    assert found.session.vector @ found.session.vector < 0.2 * found.first.vector @ found.first.vector


def test_what_cannot_be_told_beside_others_is_not_named_and_takes_its_part():
    found = found_in(pushes_of({"table_friction": 0.4, "fingertip_friction": 0.7}))
    values = {row.effect: row.value for row in found.estimates}
    assert "fingertip_friction" not in values
    assert values["table_friction"] == pytest.approx(0.4, abs=0.05)


def test_of_a_cube_as_it_should_be_nothing_is_found():
    found = found_in(pushes_of({}))
    assert found.estimates == ()
    verdict = verdict_of_several(found, OF_MANY, CALIBRATION, {})
    assert verdict.verdict is VerdictKind.NOTHING_WRONG


def test_with_too_few_pushes_reports_alone_are_judged():
    evidence = CubeEvidence(LATE, (), 0.004)
    verdict = verdict_of_several(Several.without_pushes(evidence, OF_MANY.null), OF_MANY, CALIBRATION, {})
    assert verdict.verdict is VerdictKind.NAMED
    assert {cause.effect for cause in verdict.causes} == {"tracking_latency"}


def test_what_reports_show_stands_beside_what_pushes_show():
    found = found_in(pushes_of({"table_friction": 0.5}, LATE))
    verdict = verdict_of_several(found, OF_MANY, CALIBRATION, {})
    assert verdict.verdict is VerdictKind.NAMED
    assert {cause.effect for cause in verdict.causes} == {"table_friction", "tracking_latency"}
    assert "table friction (coefficient 0.5" in verdict.summary


def test_what_no_cause_explains_is_told_with_what_it_follows():
    def evidence_with(base: ReplayedRobot) -> CubeEvidence:
        evidence = pushes_of({"table_friction": 0.8}, LATE)(base)
        (push, *_) = evidence.replayed
        lifted = replace(push, residual=push.residual + 8.0 * (push.channel == 2))
        return replace(evidence, replayed=(lifted,) * PUSHES)

    verdict = verdict_of_several(found_in(evidence_with), OF_MANY, CALIBRATION, {})
    assert verdict.verdict is VerdictKind.UNEXPLAINED
    assert {cause.effect for cause in verdict.causes} == {"tracking_latency"}, "reports show it whatever pushes show"
    assert "Its reports show tracking latency" in verdict.summary
    assert "Pushes do not move the cube as they should" in verdict.summary
    assert "force_up" in verdict.follows[0] and not any("delay" in name for name in verdict.follows)
