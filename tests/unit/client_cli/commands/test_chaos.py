"""What ``trifarm chaos`` shows of a run, and how it ends; the run itself is a process of its own."""

import json
import sys

import pytest
from typer.testing import CliRunner

from chaos import run
from chaos.faults.fault import Injection
from chaos.promises import Evidence, Verdict, check
from client_cli.commands import chaos
from client_cli.main import app

ABOUT = run.About("scale", "matrix", 7, True, True, True, 2, 0.5, 61.0)
INJECTIONS = [
    Injection("kill-api", 1, verified=True, seen="ready again after 2.0 s"),
    Injection("jumping-clock", 0, verified=False, skipped_because="libfaketime is not installed"),
]
RUNS = "import sys; open(sys.argv[sys.argv.index('--out') + 1], 'w').write(sys.argv[1]); sys.exit(int(sys.argv[2]))"


def document(**broken):
    found = dict.fromkeys(chaos.PROMISES, ()) | broken
    return run.document(
        Verdict(found, acknowledged=200, trials_done=199, failed_jobs=0, stale_refused=3, stale_accepted=0), INJECTIONS, ABOUT
    )


@pytest.fixture
def ran(monkeypatch):
    """The command with a process in place of the run that says what it is told to."""

    def call(said, code, *flags):
        asked = []

        def command(*arguments):
            asked.append(arguments)
            return [sys.executable, "-c", RUNS, json.dumps(said), str(code), *arguments]

        monkeypatch.setattr(chaos, "clone_command", command)
        return CliRunner().invoke(app, ["chaos", *flags]), asked

    return call


def test_promises_that_were_kept_end_well(ran, tmp_path):
    out = tmp_path / "run.json"
    result, asked = ran(document(), 0, "--quick", "--seed", "7", "--home", "scale", "--out", str(out))
    assert result.exit_code == 0
    assert asked[0][:8] == ("chaos", "run", "--home", "scale", "--campaign", "matrix", "--seed", "7")
    assert "--quick" in asked[0]
    assert "promises kept" in result.stdout
    assert "ready again after 2.0 s" in result.stdout
    assert "libfaketime is not installed" in result.stdout
    assert json.loads(out.read_text()) == json.loads(json.dumps(document()))


def test_a_broken_promise_is_shown_and_exits_with_1(ran):
    result, _ = ran(document(lost=("job j1 was acknowledged to client-0 and is not there",)), 1)
    assert result.exit_code == 1
    assert "lost: job j1 was acknowledged to client-0 and is not there" in result.stdout
    assert "promises BROKEN" in result.stdout


def test_a_file_that_cannot_be_written_is_said_before_the_run(ran, tmp_path):
    for out in (tmp_path, tmp_path / "none" / "run.json"):
        result, asked = ran(document(), 0, "--out", str(out))
        assert str(result.exception).startswith(f"cannot write {out}: ")
        assert not asked, "nothing was started"


@pytest.mark.parametrize("as_json", [False, True])
def test_a_file_that_takes_nothing_at_the_end_costs_no_run(ran, as_json):
    result, _ = ran(document(), 0, "--out", "/dev/full", *(["--json"] if as_json else []))
    assert str(result.exception) == "cannot write /dev/full: No space left on device"
    assert result.exception.after_document is as_json
    if as_json:
        assert json.loads(result.stdout) == json.loads(json.dumps(document()))
    else:
        assert "promises kept" in result.stdout


def test_json_is_the_document(ran):
    result, _ = ran(document(), 0, "--json")
    assert json.loads(result.stdout) == json.loads(json.dumps(document()))


def test_a_run_that_could_not_be_made_says_why(ran):
    result, _ = ran({"error": "postgres is not installed"}, 2)
    assert result.exit_code != 0
    assert str(result.exception) == "postgres is not installed"


def test_every_promise_of_the_checker_is_shown():
    assert set(check(Evidence((), {}, (), (), {}, {}, 0.0, 0.0), bool).broken) == set(chaos.PROMISES)


def test_what_a_home_does_not_have_is_not_broken_on_it():
    result = CliRunner().invoke(app, ["chaos", "--campaign", "outages", "--quick"])
    assert result.exit_code != 0
    assert str(result.exception) == "the campaign outages needs a home that 'embedded' has not: add --home scale"
