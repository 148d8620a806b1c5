"""The demo's steps against a server that is there already; the farm itself is tested with ``up``."""

import os
from contextlib import contextmanager
from pathlib import Path

import pytest

from api_schemas.job import JobState
from client_cli.connection.settings import load_connection
from client_cli.embedded.farm import EmbeddedFarm
from tests.unit.client_cli.farm_server import JOB_ID


@pytest.fixture
def demo(farm, trifarm, tmp_path, monkeypatch):
    @contextmanager
    def running(options):
        assert (options.port, options.home) == (0, options.data / "home")
        assert os.umask(0o077) == 0o077, "what the farm makes is private"
        yield EmbeddedFarm(load_connection(os.environ), "", options.data, 4, "nominal", Path(), ())

    monkeypatch.setattr("client_cli.commands.demo.embedded_farm", running)
    farm.logs = {f"{JOB_ID}-{n:03d}": b"log" for n in range(3)}
    (tmp_path / "expert.onnx").write_bytes(b"abc")
    arguments = ["--policy", str(tmp_path / "expert.onnx"), "--layout", "pose", "--dir", str(tmp_path / "demo")]
    return lambda *more: trifarm("demo", *arguments, *more)


def test_a_demo_prints_the_report_and_where_the_logs_are(farm, demo, tmp_path):
    ended = demo()
    logs = tmp_path / "demo" / f"logs-{JOB_ID}"
    assert ended.code == 0
    assert ended.out.startswith("push: 2 of 3 trials succeeded\n")
    assert f"trifarm replay {logs}/trial-000.mcap --verify" in ended.out
    assert sorted(path.name for path in logs.iterdir()) == ["report.json", *(f"trial-00{n}.mcap" for n in range(3))]
    assert (farm.submissions[0][0].trials, farm.submissions[0][0].seed) == (40, 1)


def test_a_demo_as_json_is_one_document(demo, tmp_path):
    document = demo("--json").document
    assert document["report"]["trials"] == 3
    assert document["logs"] == str(tmp_path / "demo" / f"logs-{JOB_ID}")


def test_a_demo_whose_job_fails_says_why(farm, demo):
    farm.state = JobState.FAILED
    ended = demo()
    assert ended.code == 3
    assert "robot-1 vanished 5 times" in ended.out


def test_a_demo_checks_the_policy_before_it_starts_a_farm(trifarm):
    ended = trifarm("demo", "--policy", "absent.onnx")
    assert ended.code == 2
    assert "starting" not in ended.err
