"""With ``--json`` a command that fails prints one document, whoever found out: the command line, the farm or a child process."""

import json
import runpy
from pathlib import Path

import pytest

from client_cli.main import GROUPS, run
from tests import ROOT
from tests.unit.client_cli.farm_server import JOB_ID, LADDER_ID

commands = runpy.run_path(str(ROOT / "docs/cli_pages.py"))["commands"]
PUSH = str(ROOT / "sim_backend/training/reference_policies/push.safetensors")
TRIAL = f"{JOB_ID}-000"
OF_A_FARM = [["jobs"], ["watch", JOB_ID], ["label", JOB_ID, "--name", "a"], ["cancel", JOB_ID], ["report", JOB_ID]]
OF_A_FARM += [["compare", JOB_ID, JOB_ID], ["ladder", LADDER_ID], ["why", TRIAL], ["leaderboard", "push"], ["top"], ["status"]]
OF_A_FARM += [["fetch", JOB_ID, "--table", "t.csv"], ["share", "create", JOB_ID], ["share", "list"], ["share", "revoke", "s1"]]
OF_A_FARM += [
    ["policy", "delete", "0" * 64],
    ["robots"],
    ["canary"],
    ["canary", "off"],
    ["token", "list"],
    ["token", "revoke", "t"],
]
OF_A_FARM += [["robots", each, "robot-0"] for each in ("drain", "resume", "forget")]
OF_A_FARM += [["token", "create", "--owner", "ann", "--scope", "submit"], ["identify", "--robot", "robot-0", "--to", "logs"]]
OF_A_FARM += [["submit", PUSH, "--task", "push"], ["canary", "set", PUSH, "--task", "push", "--at-least", "0.5"]]
ALONE = [["demo", "--policy", "absent.onnx"], ["check", "absent.onnx"], ["layouts", "absent"], ["up", "--physics", "absent"]]
ALONE += [["backup", "--to", "to", "--data", "absent"], ["restore", "--from", "absent", "--data", "absent"]]
ALONE += [["doctor", "--data", "absent"], ["pack", "absent.pt", "--layout", "push"], ["verify", "absent.html"]]
ALONE += [["replay", "absent.mcap"], ["chaos", "--campaign", "outages"], ["gap", "blind-test", "--out", "a-file", "--cases", "1"]]
IN_A_CHILD = [
    ["look", "broken"],
    ["video", "broken"],
    ["replay", "broken"],
    ["gap", "study", "broken"],
    ["gap", "excite", "broken"],
]
IN_A_CHILD += [["gap", "replay", "broken", "broken"], ["physics", "--robot", "robot-0", "--data", ".", "--physics", "real"]]
IN_A_CHILD += [["cluster", "status", "--cluster", "127.0.0.1:9"], ["calibrate-tracker", "--rows", "broken"]]
IN_A_CHILD += [["train", "absent"], ["train", "push", "--out", "no-run", "--resume"], ["train", "tracker", "--out", "begun"]]
IN_A_CHILD += [["experiment", "memory", "--only", "absent"]]
FAILING = OF_A_FARM + ALONE + IN_A_CHILD
CANNOT_FAIL = {"effects"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Nobody answers at the farm's address, and the files here cannot be used."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRIFARM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TRIFARM_URL", "http://127.0.0.1:9")
    Path("broken").write_text("neither a log nor a table nor a study\n")
    Path("a-file").write_text("")
    Path("begun").mkdir()
    Path("begun/checkpoint.pt").write_text("")


@pytest.mark.parametrize("command", FAILING, ids=" ".join)
def test_a_failure_is_exactly_one_document(capfd, command):
    with pytest.raises(SystemExit) as end:
        run([*command, "--json"])
    out, err = capfd.readouterr()
    assert end.value.code, "it did not fail"
    error = json.loads(out)["error"]
    assert {"title", "detail", "exit_code"} <= set(error)
    assert error["exit_code"] == end.value.code
    assert error["detail"] in err


def test_every_command_is_tried():
    paths = {path for group in GROUPS.values() for name in group for path, _ in commands(name)}
    tried = {path for path in paths if any(each[: len(path.split())] == path.split() for each in FAILING)}
    assert tried == paths - CANNOT_FAIL
