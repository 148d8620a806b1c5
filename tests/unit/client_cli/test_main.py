"""How any command ends when a file cannot be written, a pipe is closed, or Ctrl-C comes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from client_cli.commands import report
from services.jobs.reports import sign
from services.signing import FarmKey
from sim_backend import refusal
from tests.unit.client_cli.farm_server import JOB_ID
from tests.unit.report_views.test_text import report as some_report
from tests.unit.report_views.test_text import trial

ROOT = Path(__file__).resolve().parents[3]
NOBODY = "http://127.0.0.1:9"
ENTRY = (sys.executable, "-m", "client_cli")


@pytest.fixture
def signed(monkeypatch, tmp_path):
    body = some_report(trial(0))
    signature = sign(body.model_dump(mode="json"), FarmKey.of(tmp_path))
    monkeypatch.setattr(report, "_signed", lambda *_: (body, signature))


@pytest.mark.parametrize("flag", ["--html", "--pdf"])
@pytest.mark.parametrize("path", ["/nonexistent/report", "/"])
def test_a_report_that_cannot_be_written_is_wrong_usage(farm, trifarm, signed, flag, path):
    ended = trifarm("report", JOB_ID, flag, path, "--json")
    assert ended.code == 2
    assert ended.document["error"]["exit_code"] == 2
    assert ended.document["error"]["detail"].startswith(f"cannot use {path}: ")
    assert ended.err.startswith(f"error: cannot use {path}: ")


@pytest.mark.parametrize("command", [["fetch", JOB_ID, "--to"], ["up", "--robots", "1", "--data"]], ids=lambda it: it[0])
@pytest.mark.parametrize("path", ["/proc/nothing", "/dev/null"])
def test_a_folder_that_cannot_be_made_is_wrong_usage(farm, trifarm, command, path):
    ended = trifarm(*command, path, "--json")
    assert ended.code == 2
    assert f"cannot use {path}: " in ended.document["error"]["detail"]


def test_a_full_disk_behind_stdout_is_one_line(farm):
    with Path("/dev/full").open("w") as full:
        ended = _run("report", JOB_ID, "--json", stdout=full)
    assert (ended.returncode, ended.stderr) == (2, "error: cannot use the standard output: No space left on device\n")


def test_a_full_disk_behind_stderr_changes_no_exit_code():
    with Path("/dev/full").open("w") as full:
        ended = _run("status", stdout=subprocess.PIPE, stderr=full, url=NOBODY)
    assert (ended.returncode, ended.stdout) == (4, "")


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize("command", [["status"], ["status", "--json"]], ids=" ".join)
def test_a_stream_that_the_caller_closed_changes_no_exit_code_either(closed, command):
    ended = _run(*command, stdout=subprocess.PIPE, url=NOBODY, closed=closed)
    told = [] if 2 in closed else ["error: no trifarm server answers at"]
    assert (ended.returncode, [line[:35] for line in ended.stderr.splitlines()]) == (4, [line[:35] for line in told])
    assert ("exit_code" in ended.stdout) is (1 not in closed and "--json" in command)


@pytest.mark.parametrize("command", [["effects"], ["effects", "--json"], ["robots"]], ids=" ".join)
def test_a_closed_pipe_is_no_error_to_talk_about(farm, command):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as closed:
        ended = _run(*command, stdout=closed)
    assert (ended.returncode, ended.stderr) == (1, "")


IN_A_PROCESS_OF_ITS_OWN = ["experiment", "--list"]


def test_a_closed_pipe_behind_a_command_s_own_process_is_no_error_either():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as closed:
        ended = _run(*IN_A_PROCESS_OF_ITS_OWN, stdout=closed)
    assert (ended.returncode, ended.stderr.splitlines()[1:]) == (1, []), "the first line says where results are"


def test_a_full_disk_behind_a_command_s_own_process_is_one_line():
    with Path("/dev/full").open("w") as full:
        ended = _run(*IN_A_PROCESS_OF_ITS_OWN, stdout=full)
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[1:] == ["error: cannot use the standard output: No space left on device"]


def test_a_pipe_that_breaks_elsewhere_in_a_program_is_told():
    def program():
        raise BrokenPipeError("a worker has gone")

    with pytest.raises(BrokenPipeError, match="a worker has gone"):
        refusal.ended(program)


def test_ctrl_c_ends_any_command_with_130_and_no_words(trifarm, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("client_cli.commands.status.load_connection", interrupt)
    ended = trifarm("status")
    assert (ended.code, ended.out, ended.err) == (130, "", "")


def test_ctrl_c_while_the_command_is_loaded_is_no_traceback(tmp_path):
    (tmp_path / "rich.py").write_text("import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n")
    ended = _run("status", stdout=subprocess.PIPE, path=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def test_the_installed_command_begins_where_the_module_does():
    assert 'trifarm = "client_cli.entry:main"' in (ROOT / "pyproject.toml").read_text()
    assert "client_cli.entry" in (ROOT / "client_cli" / "__main__.py").read_text()


def _run(*arguments, stdout, path=None, stderr=subprocess.PIPE, url=None, closed=()):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(str(each) for each in (path, ROOT) if each)}
    environment |= {} if url is None else {"TRIFARM_URL": url}
    how = {"stdout": stdout, "stderr": stderr, "text": True, "timeout": 120}

    def close():
        for each in closed:
            os.close(each)

    return subprocess.run([*ENTRY, *arguments], env=environment, preexec_fn=close if closed else None, check=False, **how)
