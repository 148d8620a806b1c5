"""Studies of a cube with hypotheses left out."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.cube import HYPOTHESES, KINDS
from sim_backend.reality_gap.subjects.cube.gates import GATE_P
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.study import study_evidence
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.reality_gap.verdict import VerdictKind

CALIBRATION = load_calibration()


def _study(delay_s=0.09, gaps=1, jumps=0, without=()):
    tracker = TrackerStatistics(500, 0.1, delay_s, 0.003, gaps, gaps, jumps, 450, 0.0324, 0.001, 0.0115, 0.916)
    return study_evidence(CubeEvidence(tracker, ()), np.random.default_rng(1), CALIBRATION, without=without)


def test_every_hypothesis_is_of_one_kind():
    assert sorted(effect for effects in KINDS.values() for effect in effects) == sorted(HYPOTHESES)


def test_a_healthy_tracker_is_healthy():
    assert _study().verdict.verdict is VerdictKind.NOTHING_WRONG


@pytest.mark.parametrize(
    ("wrong", "effect"),
    [({"delay_s": 0.13}, "tracking_latency"), ({"gaps": 40}, "tracking_dropout"), ({"jumps": 25}, "orientation_jumps")],
)
def test_without_the_true_hypothesis_something_is_wrong_and_nothing_is_named(wrong, effect):
    assert [cause.effect for cause in _study(**wrong).verdict.causes] == [effect]
    left = _study(**wrong, without=(effect,)).verdict
    assert left.verdict is VerdictKind.UNEXPLAINED
    assert left.follows and not left.causes


def test_poses_that_hardly_scatter_are_no_fault_of_a_tracker_s_noise():
    """They are smoothed, or the tracker is a better one; both is no cause of the catalogue."""
    tracker = TrackerStatistics(500, 0.1, 0.09, 0.003, 1, 1, 0, 450, 0.0324, 0.0001, 0.0115, 0.916)
    verdict = study_evidence(CubeEvidence(tracker, ()), np.random.default_rng(1), CALIBRATION).verdict
    assert verdict.verdict is VerdictKind.UNEXPLAINED and not verdict.causes
    assert verdict.summary == "something is wrong that no cause of the catalogue explains"
    assert any("log_noise_m" in text for text in verdict.follows)


def test_a_cause_that_leaves_a_number_far_off_is_no_name():
    """Reports come in two delays by turns: late in the mean, which leaves how much they differ."""
    tracker = TrackerStatistics(500, 0.1, 0.14, 0.05, 1, 1, 0, 450, 0.0324, 0.001, 0.0115, 0.916)
    verdict = study_evidence(CubeEvidence(tracker, ()), np.random.default_rng(1), CALIBRATION).verdict
    assert verdict.verdict is VerdictKind.UNEXPLAINED and not verdict.causes


def test_chance_is_judged_kind_by_kind():
    top = {kind: CALIBRATION.gains[kind][-1] for kind in KINDS}
    assert all(CALIBRATION.gain_p(kind, top[kind] + 20.0) <= GATE_P for kind in KINDS)
    assert CALIBRATION.gain_p("pushes", top["tracker"]) > GATE_P
