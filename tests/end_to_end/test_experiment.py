"""The quick form of an experiment from its command to its page: it trains, starts a farm, submits and judges.

Stopped on the way it leaves nothing that runs, and no farm's folder; the same command goes on.
"""

import json
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from experiments.__main__ import main
from tests.end_to_end.farm import TRIFARM


def experiment(*flags: str) -> dict:
    """What the command prints, which succeeds."""
    command = [*TRIFARM, "experiment", "randomization", "--quick", "--json", *flags]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def processes_of(folder: Path) -> list[str]:
    """Commands of all processes that name a folder, which have not ended."""
    commands = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue  # it has ended meanwhile
        if str(folder) in command:
            commands.append(command)
    return commands


def stop_when(number: signal.Signals, is_time: Callable[[], bool], out: Path, work: Path) -> str:
    """Begin, stop it by a signal to the command when it is time; what it said."""
    command = [*TRIFARM, "experiment", "randomization", "--quick", "--out", str(out), "--work", str(work)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        until_s = time.monotonic() + 280.0
        while not is_time() and running.poll() is None and time.monotonic() < until_s:
            time.sleep(0.05)
        assert running.poll() is None and is_time()
        running.send_signal(number)
        said = running.communicate(timeout=120)[1]
    assert running.returncode == 130, said
    return said


@pytest.mark.timeout(900)
def test_the_quick_form_trains_tries_on_a_farm_and_judges(tmp_path, capsys):
    out, work = tmp_path / "results", tmp_path / "work"
    farm = work / "randomization" / "farm"
    said = stop_when(signal.SIGINT, lambda: bool([*farm.glob("*/logs/robots.log")]), out, work)
    assert "has been stopped; the same command goes on" in said
    assert processes_of(work) == [] and not farm.exists(), "a farm's folder is large"
    assert len([*out.glob("*/runs/*-seed1.json")]) == 2, "what was finished is kept"
    whole = experiment("--out", str(out), "--work", str(work))
    assert whole["state"] == "complete" and whole["quick"] and whole["missing"] == []
    assert {(each["cell"], each["physics"], each["trials"]) for each in whole["cells"]} == {
        ("nominal", "real", 2),
        ("randomized", "real", 2),
    }
    assert whole["contrasts"][0]["found"]["n"] == 2
    assert len(list((work / "starts").iterdir())) == 1, "both go on from one start"
    page = (out / "randomization.md").read_text()
    assert "The quick form" in page and "![" in page
    assert (out / "randomization.svg").stat().st_size > 0 and (out / "randomization.png").stat().st_size > 0
    assert main(["randomization", "--quick", "--json", "--out", str(out), "--list"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert all(piece["done"] for piece in listed["pieces"]) and listed["hours_left"] == 0


@pytest.mark.scale
@pytest.mark.timeout(900)
def test_stopped_while_a_start_is_trained_it_leaves_nothing_that_runs(tmp_path):
    """`test_a_signal_while_a_start_is_trained_ends_the_start_too` has it of a process in place of the training."""
    out, work = tmp_path / "results", tmp_path / "work"
    said = stop_when(signal.SIGTERM, lambda: bool([*(work / "starts").glob("*/log")]), out, work)
    assert processes_of(work) == [], "a start that lost its parent would train on"
    assert "has been stopped; the same command goes on" in said
    assert experiment("--out", str(out), "--work", str(work))["state"] == "complete"
