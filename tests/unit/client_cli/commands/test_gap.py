"""``trifarm gap`` with small programs in the place of the reality gap: what is passed on, and how they end."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from client_cli.main import run
from tests import ROOT
from tests.cli_pages import SECTIONS, names_after
from tests.processes import wait_until_gone

MODULE = "sim_backend.reality_gap"
STUBBORN = """
import pathlib, signal, subprocess, sys, time
deaf = "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); time.sleep(300)"
worker = subprocess.Popen([sys.executable, "-c", deaf])
pathlib.Path("worker.pid").write_text(str(worker.pid))
try:
    time.sleep(300)
except KeyboardInterrupt:
    pathlib.Path("in-order").touch()
    sys.exit(130)
"""
CLIENT = f"""
import signal, sys
from client_cli import main
from client_cli.commands import gap
signal.signal(signal.SIGHUP, signal.SIG_DFL)
gap.module_command = lambda *_: [sys.executable, "-c", {STUBBORN!r}]
main.run(["gap", "blind-test", *sys.argv[1:]])
"""


@pytest.fixture
def child(monkeypatch):
    """Lets a program stand for the reality gap; gives the list of what it was asked."""
    asked = []

    def use(program):
        def command(module, *arguments):
            asked.append([module, *arguments])
            return [sys.executable, "-c", program, *arguments]

        monkeypatch.setattr("client_cli.commands.gap.module_command", command)
        return asked

    return use


@pytest.fixture
def study_file(tmp_path):
    path = tmp_path / "study.toml"
    path.touch()
    return str(path)


def test_what_is_not_given_is_left_to_the_child(trifarm, child, study_file):
    asked = child("")
    assert trifarm("gap", "study", study_file).code == 0
    assert trifarm("gap", "blind-test").code == 0
    assert trifarm("gap", "excite").code == 0
    assert asked == [[MODULE, "study", study_file, "--method", "naming"], [MODULE, "blind-test"], [MODULE, "excite"]]


def test_a_study_with_all_flags(trifarm, child, study_file, tmp_path):
    asked = child("")
    flags = ["--data", str(tmp_path), "--out", "results", "--method", "simopt", "--seed", "3"]
    flags += ["--trials", "lift", "--policy", "lift.onnx", "--manifest", "rrc2022-lift", "--json"]
    assert trifarm("gap", "study", study_file, *flags).code == 0
    assert asked == [[MODULE, "study", study_file, *flags]]


def test_a_folder_of_logs_is_a_study_too(trifarm, child, tmp_path):
    asked = child("")
    assert trifarm("gap", "study", str(tmp_path), "--method", "coordinate-descent").code == 0
    assert asked == [[MODULE, "study", str(tmp_path), "--method", "coordinate-descent"]]


def test_a_blind_test_with_all_flags(trifarm, child):
    asked = child("")
    flags = ["--cases", "4", "--seed", "9", "--excitation", "everything", "--out", "kept", "--processes", "2", "--json"]
    assert trifarm("gap", "blind-test", *flags).code == 0
    assert asked == [[MODULE, "blind-test", *flags]]


def test_advice_with_all_flags(trifarm, child, tmp_path):
    asked = child("")
    model = tmp_path / "arm.xml"
    model.touch()
    (tmp_path / "study.json").touch()
    flags = ["--robot", "robot-2", "--excitation", "chirps", "--csv", "t.csv", "--model", str(model), "--seed", "1", "--json"]
    assert trifarm("gap", "excite", str(tmp_path), *flags).code == 0
    assert asked == [[MODULE, "excite", str(tmp_path), *flags]]


@pytest.mark.parametrize("code", [0, 1, 2, 130])
def test_the_exit_code_is_the_childs(trifarm, child, code):
    child(f"import sys; sys.exit({code})")
    assert trifarm("gap", "excite").code == code


def test_both_streams_are_passed_through(child, home, capfd):
    child("import sys; print('{}'); print('50 %, about 10 s left', file=sys.stderr)")
    with pytest.raises(SystemExit, match="0"):
        run(["gap", "excite", "--json"])
    assert capfd.readouterr() == ("{}\n", "50 %, about 10 s left\n")


@pytest.mark.parametrize(
    ("program", "said"),
    [("import sys; sys.exit(77)", "code 77"), ("import os; os.kill(os.getpid(), 9)", "signal 9 (out of memory?)")],
)
def test_a_child_that_ends_strangely_is_an_error(trifarm, child, program, said):
    child(program)
    ended = trifarm("gap", "blind-test", "--json")
    assert ended.code == 1
    assert said in ended.document["error"]["detail"]
    assert ended.err.startswith("error: ")


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["study", "absent.toml"], "absent.toml"),
        (["study"], "STUDY.toml"),
        (["study", str(ROOT), "--data", "absent"], "absent"),
        (["study", str(ROOT), "--method", "guess"], "guess"),
        (["study", str(ROOT), "--trials", "lift"], "go together"),
        (["blind-test", "--cases", "-1"], "--cases"),
        (["blind-test", "--processes", "0"], "--processes"),
        (["excite", "absent.json"], "absent.json"),
        (["excite", "--model", "absent.xml"], "absent.xml"),
        (["excite", str(ROOT)], "holds no study.json"),
        (["excite", "--csv", "/nonexistent/n.csv"], "cannot write /nonexistent/n.csv"),
    ],
    ids=" ".join,
)
def test_wrong_usage_starts_no_child(trifarm, child, flags, said):
    asked = child("")
    ended = trifarm("gap", *flags)
    assert ended.code == 2
    assert said in ended.err
    assert not asked


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_ends_the_child_in_order_and_what_it_started(tmp_path, number):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", CLIENT, "--json"]
    client = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    with client:
        worker = int(_appears(tmp_path / "worker.pid"))
        client.send_signal(number)
        out, err = client.communicate(timeout=120)
    assert client.returncode == 130
    assert (tmp_path / "in-order").exists()
    assert json.loads(out)["error"]["title"] == "interrupted"
    assert b"the same command goes on where it stopped" in err
    wait_until_gone(worker)


def _appears(path, patience_s=120.0):
    end_s = time.monotonic() + patience_s
    while not path.exists() or not path.read_text():
        assert time.monotonic() < end_s, f"{path} does not appear"
        time.sleep(0.02)
    return path.read_text()


def test_documented_keys_are_those_of_the_reality_gap():
    from sim_backend.reality_gap.advice.advice import first_advice
    from sim_backend.reality_gap.advice.answer import document
    from sim_backend.reality_gap.bench.joints import summary
    from sim_backend.reality_gap.verdict import Verdict, VerdictKind

    verdict = Verdict(VerdictKind.NOTHING_WRONG, "").document()
    assert names_after("JSON keys", SECTIONS["gap study STUDY.toml|LOGDIR"]) == [*verdict, "files"]
    assert names_after("JSON keys", SECTIONS["gap blind-test"]) == list(summary([]))
    assert names_after("JSON keys", SECTIONS["gap excite STUDY_OR_REPORT"]) == list(document(None, first_advice(), "any", None))


def test_the_real_reality_gap_answers(home, capfd):
    with pytest.raises(SystemExit, match="0"):
        run(["gap", "excite", "--json"])
    document = json.loads(capfd.readouterr().out)
    assert document["command"].startswith("trifarm identify --robot any --excitation standard")
