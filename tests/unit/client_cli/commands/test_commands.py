"""The short commands: what they ask, what they print, and how they end when something is wrong."""

import json
import subprocess
import sys

import pytest

from api_schemas.error import Problem
from tests.unit.client_cli.farm_server import JOB_ID, TOKEN

READING = [["jobs"], ["watch", JOB_ID], ["cancel", JOB_ID], ["report", JOB_ID], ["robots"], ["robots", "drain", "robot-0"]]
READING += [
    ["robots", "resume", "robot-0"],
    ["robots", "forget", "robot-0"],
    ["status"],
    ["token", "list"],
    ["token", "revoke", "t1"],
]
READING += [["token", "create", "--owner", "ann", "--scope", "submit"], ["fetch", JOB_ID, "--to", "unused"]]
LOCAL = [["layouts"], ["layouts", "push"], ["effects"]]


def name_of(command):
    return " ".join(command[:2])


@pytest.mark.parametrize("command", READING[:-1] + LOCAL + [["fetch", JOB_ID, "--table", "t.csv"]], ids=name_of)
def test_json_is_exactly_one_document(farm, trifarm, monkeypatch, tmp_path, command):
    monkeypatch.chdir(tmp_path)
    ended = trifarm(*command, "--json")
    assert ended.code == 0
    assert isinstance(ended.document, dict)


@pytest.mark.parametrize("command", READING[:-1], ids=name_of)
def test_people_get_text(farm, trifarm, command):
    ended = trifarm(*command)
    assert ended.code == 0
    assert ended.out.strip()


@pytest.mark.parametrize("command", READING, ids=name_of)
def test_a_server_that_is_away_is_one_clear_line(trifarm, monkeypatch, command):
    monkeypatch.setenv("TRIFARM_URL", "http://127.0.0.1:9")
    ended = trifarm(*command)
    assert (ended.code, ended.out) == (4, "")
    assert ended.err.count("\n") == 1
    assert ended.err.startswith("error: no trifarm server answers at http://127.0.0.1:9 (")
    assert "'trifarm up'" in ended.err


@pytest.mark.parametrize("command", READING, ids=name_of)
def test_a_problem_document_is_shown_with_its_title(farm, trifarm, command):
    farm.problem = Problem(type="/problems/odd", title="odd request", status=422, detail="the value is 5, the limit 4")
    ended = trifarm(*command)
    assert (ended.code, ended.out) == (5, "")
    assert ended.err == "error: the value is 5, the limit 4 (odd request)\n"


@pytest.mark.parametrize(
    "command",
    [["report"], ["watch"], ["cancel"], ["ladder"], ["robots", "drain"], ["robots", "forget"], ["token", "revoke"]],
    ids=name_of,
)
@pytest.mark.parametrize("odd", ["", "../x", "a/b", "..", "a?b", "a b"])
def test_what_is_no_id_is_asked_of_nobody(trifarm, monkeypatch, command, odd):
    monkeypatch.setenv("TRIFARM_URL", "http://127.0.0.1:9")
    ended = trifarm(*command, odd)
    assert ended.code == 2
    assert f"{odd!r} is no id of a " in ended.err


def test_hints_of_the_server_name_commands_here(farm, trifarm):
    detail = "There is no job jx of yours; GET /v1/jobs lists them."
    farm.problem = Problem(type="/problems/job-not-found", title="Not found", status=404, detail=detail)
    assert trifarm("report", "jx").err == "error: There is no job jx of yours; 'trifarm jobs' lists them. (Not found)\n"
    assert trifarm("report", "jx", "--json").document["error"]["detail"] == detail


def test_errors_are_documents_too(farm, trifarm):
    farm.problem = Problem(type="/problems/odd", title="odd", status=409, detail="no")
    document = trifarm("robots", "--json").document
    expected = {"title": "odd", "detail": "no", "exit_code": 5, "type": "/problems/odd", "status": 409}
    assert document == {"error": expected}


def test_a_wrong_token_says_where_tokens_come_from(farm, trifarm, monkeypatch):
    monkeypatch.setenv("TRIFARM_TOKEN", "wrong")
    ended = trifarm("status")
    assert ended.code == 5
    assert "TRIFARM_TOKEN" in ended.err


def test_a_stranger_on_the_port_is_recognised(farm, trifarm, monkeypatch):
    farm.report = b"<html>not json</html>"
    monkeypatch.setattr("tests.unit.client_cli.farm_server.STATUS", {"unknown": 1})
    ended = trifarm("status")
    assert ended.code == 1
    assert "is it a trifarm server of the same version?" in ended.err


def test_robots_json_has_the_promised_keys(farm, trifarm):
    (robot,) = trifarm("robots", "--json").document["robots"]
    assert {"robot", "state", "pid", "host", "trial", "reason"} <= set(robot)
    assert "no sign of life" in trifarm("robots").out


def test_in_a_pipe_each_row_is_one_line(farm, trifarm, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    header, row = trifarm("robots").out.splitlines()
    assert header.startswith("robot")
    assert row.endswith("no sign of life since 3 s")


def test_drain_resume_and_forget_reach_the_robot(farm, trifarm):
    assert "robot-0 is draining" in trifarm("robots", "drain", "robot-0").out
    refused = trifarm("robots", "drain", "robot0")
    assert (refused.code, "No robot named robot0; did you mean robot-0?" in refused.err) == (5, True)
    assert trifarm("robots", "resume", "robot-0").out == "robot-0 will take trials again\n", "it answers before the robot does"
    assert trifarm("robots", "forget", "robot-0").out == "robot-0 is forgotten\n"
    assert farm.commands == ["drain robot-0", "resume robot-0", "forget robot-0"]


def test_jobs_can_be_filtered_and_paged(farm, trifarm):
    assert JOB_ID in trifarm("jobs").out
    assert trifarm("jobs").err == "more: trifarm jobs --cursor more\n"
    assert trifarm("jobs", "--state", "queued", "--json").document["jobs"] == []


def test_the_command_for_the_next_page_asks_for_the_same_jobs(farm, trifarm):
    state = farm.state.value
    asked = trifarm("jobs", "--state", state, "--limit", "5", "--search", "reward")
    assert asked.err == f"more: trifarm jobs --state {state} --limit 5 --search reward --cursor more\n"


def test_status_tells_problems(farm, trifarm):
    text = trifarm("status").out
    assert "problem: robot-0 is lost" in text
    assert "3 running, 80 queued, the oldest for 5 min" in text


def test_a_new_token_is_alone_on_stdout(farm, trifarm):
    ended = trifarm("token", "create", "--owner", "ann", "--scope", "submit", "--scope", "operate")
    assert ended.out == "trifarm_t1_hush\n"


def test_a_bad_owner_is_refused_here(farm, trifarm):
    ended = trifarm("token", "create", "--owner", "a b", "--scope", "submit")
    assert ended.code == 2
    assert "'a b'" in ended.err


def test_report_json_is_the_stored_report(farm, trifarm):
    assert trifarm("report", JOB_ID, "--json").document == json.loads(farm.report)


def test_the_token_is_never_printed(farm, trifarm):
    for command in READING[:-1]:
        ended = trifarm(*command)
        assert TOKEN not in ended.out + ended.err


def test_wrong_usage_ends_with_2(trifarm):
    assert trifarm("submit").code == 2
    assert trifarm("nonsense").code == 2


def test_the_client_loads_no_simulator():
    unwanted = "{'mujoco', 'torch', 'sim_backend', 'numpy'}"
    program = f"import sys, client_cli.main; sys.exit(bool({unwanted} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
