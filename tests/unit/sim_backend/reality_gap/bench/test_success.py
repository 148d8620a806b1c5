"""Success of a policy on robots that differ everywhere: what is tried, kept and counted."""

import json
from dataclasses import replace

import pytest

from api_schemas.policy import LAYOUTS
from sim_backend.reality_gap.bench.success import EXTENDED, MEASURED, NOMINAL, line_of, main, summary, verdict_in
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind
from sim_backend.refusal import EXIT_UNUSABLE
from tests import graphs

STUDIES = [{"seed": seed, "verdict": "named", "causes": []} for seed in (1, 2)]


def tried(model, seed, first, *success):
    return {"model": model, "seed": seed, "first": first, "success": [bool(each) for each in success]}


def test_gaps_are_counted_by_robot_and_in_the_median():
    tries = [tried(NOMINAL, None, 2, 1, 1), tried(NOMINAL, None, 0, 1, 1)]
    tries += [tried(MEASURED, 1, 0, 1, 0, 1, 0), tried(EXTENDED, 1, 0, 0, 1, 0, 1)]
    tries += [tried(MEASURED, 2, 0, 1, 1, 1, 0), tried(EXTENDED, 2, 0, 0, 0, 0, 0)]
    found = summary(STUDIES, tries)
    assert (found["robots"], found["goals"], found["close"], found["close_before"]) == (2, 4, 1, 0)
    assert (found["median_gap_before"], found["median_gap_after"]) == (0.375, 0.375)
    first, second = found["by_robot"]
    assert (first["nominal"], first["extended"], first["measured"], first["gap_after"]) == (1.0, 0.5, 0.5, 0.0)
    assert (first["agreement_before"], first["agreement_after"]) == (0.5, 0.0)
    assert second["gap_after"] == -0.75


def test_what_is_missing_is_tried_and_what_is_there_is_kept(tmp_path, capsys):
    layout = "rrc2022-push"
    policy = graphs.linear(tmp_path / "policy.onnx", inputs=LAYOUTS[layout].observation_size)
    kept = [tried(model, seed, 0, 1, 0) for model, seed in ((NOMINAL, None), (MEASURED, 1), (EXTENDED, 1), (MEASURED, 2))]
    other = tried(NOMINAL, None, 0, 1, 1, 1)
    (tmp_path / "studies.jsonl").write_text("".join(json.dumps(each) + "\n" for each in STUDIES))
    (tmp_path / "tries.jsonl").write_text("".join(json.dumps(each) + "\n" for each in (*kept, other)) + '{"cut')
    call = ["--policy", str(policy), "--manifest", layout, "--task", "push", "--first-seed", "1", "--robots", "2", "--goals", "2"]
    assert main([*call, "--out", str(tmp_path), "--processes", "0"]) == 0
    assert json.loads(capsys.readouterr().out)["goals"] == 2
    *before, new = [json.loads(line) for line in (tmp_path / "tries.jsonl").read_text().splitlines()]
    assert before == [*kept, other]
    assert (new["model"], new["seed"], new["first"], len(new["success"])) == (EXTENDED, 2, 0, 2)
    assert [row["measured"] for row in json.loads((tmp_path / "success.json").read_text())["by_robot"]] == [0.5, 0.5]


def test_what_was_found_of_joints_comes_back_from_its_line():
    cause = Cause("coulomb_friction", "torque_nm", "finger0_base_to_upper", 0.04, "N m", (0.03, 0.05))
    verdict = Verdict(VerdictKind.NAMED, "friction", (cause,), (replace(cause, value=0.03),), cannot_tell=("much",))
    assert verdict_in(json.loads(json.dumps(line_of(verdict)))) == verdict


@pytest.mark.parametrize(
    ("policy", "out", "said"),
    [("none.onnx", "new", "no policy file"), ("policy.onnx", "/proc/nothing", "cannot use /proc/nothing")],
)
def test_what_cannot_be_used_is_said_before_any_work(policy, out, said, tmp_path, capsys):
    graphs.linear(tmp_path / "policy.onnx", inputs=LAYOUTS["rrc2022-push"].observation_size)
    call = ["--policy", str(tmp_path / policy), "--manifest", "rrc2022-push", "--first-seed", "1", "--out", str(tmp_path / out)]
    assert main(call) == EXIT_UNUSABLE
    assert said in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
