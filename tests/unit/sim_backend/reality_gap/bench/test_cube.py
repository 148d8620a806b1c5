"""How the blind test on cubes counts."""

import numpy as np
import pytest

from sim_backend.reality_gap.bench.cube import judge_case, results
from sim_backend.reality_gap.bench.cube_cases import CubeCase
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.study import CubeStudy, study_cube, study_evidence
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind


def _study(kind: VerdictKind, *effects: str) -> CubeStudy:
    causes = tuple(Cause(effect, "factor", "cube", 1.2, "", (1.1, 1.3)) for effect in effects)
    return CubeStudy(Verdict(kind, "", causes, null_p=0.01), (), 5, 1.0)


def test_right_wrong_missed_and_false_alarms_are_told_apart():
    mass = CubeCase("effect-000", 1, "cube_mass", 2.0, (1.25,))
    healthy, joint = CubeCase("null-000", 2, "", 0.0, ()), CubeCase("joint-000", 3, "link_mass.factor", 0.0, (1.06,))
    judged = [
        judge_case(mass, _study(VerdictKind.NAMED, "cube_mass"), _study(VerdictKind.UNEXPLAINED)),
        judge_case(mass, _study(VerdictKind.CONFUSABLE, "table_friction", "cube_mass")),
        judge_case(mass, _study(VerdictKind.NAMED, "table_friction")),
        judge_case(mass, _study(VerdictKind.NOTHING_WRONG)),
        judge_case(healthy, _study(VerdictKind.NOTHING_WRONG)),
        judge_case(healthy, _study(VerdictKind.UNEXPLAINED)),
        judge_case(joint, _study(VerdictKind.UNEXPLAINED)),
    ]
    found = results(judged, load_calibration(), {})
    assert (found["n_effect"], found["n_null"]) == (4, 2)
    assert [found[key]["k"] for key in ("right_name", "wrong_name", "missed", "unexplained", "false_alarm")] == [2, 1, 1, 0, 1]
    assert {kind: (rate["k"], rate["n"]) for kind, rate in found["left_out_2x_5x"].items()}["unexplained"] == (1, 1)
    assert found["joint_errors_named_as_cube"]["k"] == 0
    assert found["median_parameter_error"] == pytest.approx(0.05 / 0.25)
    assert found["confusion"]["cube_mass"]["cube_mass or table_friction"] == 1


def test_a_late_tracker_in_a_log_without_pushes_is_named_and_a_push_is_asked_for():
    tracker = TrackerStatistics(500, 0.1, 0.13, 0.003, 1, 1, 0, 450, 0.0323, 0.001, 0.012, 0.92)
    verdict = study_evidence(CubeEvidence(tracker, ()), np.random.default_rng(1), load_calibration()).verdict
    assert verdict.verdict is VerdictKind.NAMED
    assert verdict.causes[0].effect == "tracking_latency"
    assert verdict.causes[0].interval_90[0] < 0.04 < verdict.causes[0].interval_90[1]
    assert any("slide_cube" in text for text in verdict.record_next)


def test_logs_without_a_tracked_cube_identify_nothing():
    verdict = study_cube([], np.random.default_rng(1)).verdict
    assert verdict.verdict is VerdictKind.NOT_IDENTIFIABLE
