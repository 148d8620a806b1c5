"""The quick form of an experiment from its command to its page: it trains, starts a farm, submits and judges."""

import json
import subprocess

import pytest

pytest.importorskip("torch", reason="the extra 'learning' is not installed")
pytest.importorskip("stable_baselines3", reason="the extra 'learning' is not installed")

from tests.end_to_end.farm import TRIFARM


def experiment(*flags, code=0):
    command = [*TRIFARM, "experiment", "randomization", "--quick", "--json", *flags]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=280)
    assert done.returncode == code, done.stdout + done.stderr
    return json.loads(done.stdout) if code == 0 else done.stderr, done.stderr


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_quick_form_trains_tries_on_a_farm_and_judges(tmp_path):
    out, work = tmp_path / "results", tmp_path / "work"
    whole, _ = experiment("--out", str(out), "--work", str(work))
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
    listed, _ = experiment("--out", str(out), "--list")
    assert all(piece["done"] for piece in listed["pieces"]) and listed["hours_left"] == 0


def test_a_cell_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    said, _ = experiment("--out", str(tmp_path), "--only", "nothing", code=2)
    assert "choose from nominal, randomized" in said
