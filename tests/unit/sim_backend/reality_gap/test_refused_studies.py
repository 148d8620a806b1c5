"""What a study was given is looked at before any long work, and refused in one shape."""

import json
from pathlib import Path

import pytest

from sim_backend.reality_gap import __main__, study
from tests.unit.sim_backend.reality_gap.measured.test_farm_logs import write_log


@pytest.fixture
def logs(tmp_path, monkeypatch) -> Path:
    """A folder of one robot's logs, whose rows must not be read."""

    def read(*_):
        raise AssertionError("rows were read")

    monkeypatch.setattr(study, "read_farm_logs", read)
    (tmp_path / "logs").mkdir()
    for name in ("a", "b"):
        write_log(tmp_path / "logs" / f"{name}.mcap", truth=False)
    return tmp_path / "logs"


def refusal(capsys, *arguments) -> str:
    assert __main__.main(["study", *map(str, arguments), "--json"]) == 2
    printed = capsys.readouterr()
    error = json.loads(printed.out)["error"]
    assert (error["title"], error["exit_code"]) == ("wrong usage", 2)
    assert printed.err == f"error: {error['detail']}\n"
    return error["detail"]


def test_a_folder_for_results_that_cannot_be_made(logs, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert "--out" in refusal(capsys, logs, "--out", tmp_path / "file" / "gap")
    assert "--out" in refusal(capsys, logs, "--out", tmp_path / "file")


def test_logs_of_two_robots(logs, tmp_path, capsys):
    write_log(logs / "c.mcap", truth=False, robot="beta")
    assert "of 2 robots (alpha, beta)" in refusal(capsys, logs, "--out", tmp_path / "gap")


def test_logs_of_trials_alone(tmp_path, capsys):
    write_log(tmp_path / "trial-000.mcap", truth=False, task="push")
    assert "trifarm identify" in refusal(capsys, tmp_path, "--out", tmp_path / "gap")
    assert not (tmp_path / "gap").exists()


def test_a_log_that_was_cut_off(logs, tmp_path, capsys):
    cut = logs / "c.mcap"
    cut.write_bytes((logs / "a.mcap").read_bytes()[:-500])
    assert "c.mcap" in refusal(capsys, logs, "--out", tmp_path / "gap")
    assert not (tmp_path / "gap").exists()


def test_trials_that_are_none(logs, tmp_path, capsys):
    asked = ("--trials", tmp_path, "--policy", tmp_path / "p.onnx", "--manifest", "nope")
    assert "report.json" in refusal(capsys, logs, "--out", tmp_path / "gap", *asked)


def test_a_manifest_that_is_none(logs, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sim_backend.reality_gap.success.prediction.read_measured", lambda *_: None)
    asked = ("--trials", tmp_path, "--policy", tmp_path / "p.onnx", "--manifest", "nope")
    assert "there is no manifest 'nope'" in refusal(capsys, logs, "--out", tmp_path / "gap", *asked)


def test_a_folder_without_logs(tmp_path, capsys):
    assert "has no logs" in refusal(capsys, tmp_path, "--out", tmp_path / "gap")
