"""How the blind test on cubes counts."""

import json

import numpy as np
import pytest

from sim_backend.reality_gap.bench.cube import judge_case, main, results
from sim_backend.reality_gap.bench.cube_cases import CubeCase, save_evidence
from sim_backend.reality_gap.subjects.cube.healthy import load_calibration
from sim_backend.reality_gap.subjects.cube.study import CubeStudy, study_cube, study_evidence
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind
from sim_backend.refusal import EXIT_UNUSABLE


def _study(kind: VerdictKind, *effects: str) -> CubeStudy:
    interval = (np.float64(1.1), np.float64(1.3))  # as fits give them
    causes = tuple(Cause(effect, "factor", "cube", np.float64(1.2), "", interval) for effect in effects)
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


@pytest.mark.parametrize(("said", "held"), [("named", (True,)), ("confusable", ()), ("elsewhere", ())])
def test_intervals_count_where_the_effect_is_named_alone(said, held):
    kind, names = {
        "named": (VerdictKind.NAMED, ("cube_mass",)),
        "confusable": (VerdictKind.CONFUSABLE, ("cube_mass", "table_friction")),
        "elsewhere": (VerdictKind.NAMED, ("cube_mass", "table_friction")),
    }[said]
    judged = judge_case(CubeCase("effect-000", 1, "cube_mass", 2.0, (1.25,)), _study(kind, *names))
    assert judged.held == held
    assert judge_case(CubeCase("effect-000", 1, "cube_mass", 2.0, (1.35,)), _study(kind, *names)).held == (False,) * len(held)
    found = results([judged], load_calibration(), {})
    assert found["interval_coverage"]["n"] == len(held)
    assert json.dumps(found), "it is kept as JSON"


def test_a_folder_with_all_sessions_is_judged_again_without_simulating(tmp_path, capsys):
    tracker = TrackerStatistics(500, 0.1, 0.13, 0.003, 1, 1, 0, 450, 0.0323, 0.001, 0.012, 0.92)
    for name in ("effect-000", "null-000", "joint-000"):
        save_evidence(tmp_path / f"{name}.npz", CubeEvidence(tracker, ()))
    assert main(["--cases", "1", "--seed", "5", "--out", str(tmp_path), "--processes", "0", "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert (found["n_effect"], found["n_null"], found["joint_errors_named_as_cube"]["k"]) == (1, 1, 1)
    assert found["false_alarm"]["k"] == 1, "the healthy robot's tracker was late, too"
    assert json.loads((tmp_path / "results.json").read_text()) == found
    assert "3 of 3 cases are judged" in said.err
    assert "simulated" not in said.err


def test_a_folder_that_cannot_be_used_is_named(capsys):
    assert main(["--out", "/proc/nothing"]) == EXIT_UNUSABLE
    assert capsys.readouterr().err.startswith("error: cannot use /proc/nothing: ")


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
