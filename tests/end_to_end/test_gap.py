"""The second half of the mission through the command line: a farm's logs in, cause, better model and report out."""

import json
import os
import subprocess
from pathlib import Path

import pytest

from sim_backend.trifinger.constants import JOINT_NAMES
from tests.end_to_end import commands
from tests.end_to_end.farm import Farm

JOINT, FRICTION_NM = 4, 0.03


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Of a farm whose robot has friction in one joint, with logs of its standard excitation."""
    folder = tmp_path_factory.mktemp("gap")
    friction = [FRICTION_NM if joint == JOINT else 0.0 for joint in range(9)]
    (folder / "hidden.toml").write_text(f"[coulomb_friction]\ntorque_nm = {friction}\n")
    with Farm(folder / "farm", robots=1, more=("--physics", str(folder / "hidden.toml"))) as farm:
        farm.json("identify", "--robot", "any", "--excitation", "standard", "--seed", "4", "--to", str(folder / "logs"), "--wait")
    return folder


def gap(*arguments: str) -> subprocess.CompletedProcess[str]:
    return commands.run("gap", "study", *arguments, env=os.environ)


@pytest.fixture(scope="module")
def verdict(folder) -> dict:
    done = gap(str(folder / "logs"), "--out", str(folder / "gap"), "--json")
    assert done.returncode == 0, done.stderr
    assert "%" in done.stderr  # progress
    return json.loads(done.stdout)


def test_the_hidden_cause_is_named_with_place_and_value(verdict):
    assert verdict["verdict"] == "named", verdict
    (cause,) = verdict["causes"]
    assert (cause["effect"], cause["where"], cause["unit"]) == ("coulomb_friction", JOINT_NAMES[JOINT], "N m")
    assert cause["value"] == pytest.approx(FRICTION_NM, rel=0.1)
    assert cause["interval_90"][0] < FRICTION_NM < cause["interval_90"][1]
    held_out = verdict["held_out"]
    assert held_out["noise_floor"] < held_out["after"] < held_out["before"]


def test_report_and_numbers_are_there(verdict, folder):
    page = (folder / "gap" / "report.html").read_text()
    assert "coulomb friction" in page and "http://" not in page.replace("http://www.w3.org", "")
    document = json.loads((folder / "gap" / "study.json").read_text())
    assert document["verdict"]["verdict"] == verdict["verdict"]
    assert document["robot"] == "robot-0"
    assert [len(data["sha256"]) for data in document["provenance"]["data"]] == [64]
    assert str(folder / "gap" / "extended-model.toml") in verdict["files"]


@pytest.mark.scale
def test_a_farm_runs_on_the_extended_model(verdict, folder):
    """`test_robots_run_on_it` has it of a robot's physics without the farm around it."""
    model = folder / "gap" / "extended-model.toml"
    with Farm(folder / "better", robots=1, more=("--physics", str(model))) as farm:
        assert farm.json("status")["physics"] == "file:extended-model"


@pytest.mark.scale
def test_a_broken_log_is_one_clear_error(verdict, folder, tmp_path):
    """`test_a_log_that_was_cut_off` refuses one in this process."""
    (log,) = (folder / "logs").glob("*.mcap")
    (tmp_path / log.name).write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    done = gap(str(tmp_path), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert log.name in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.scale
def test_a_number_that_is_none_is_refused_with_column_and_row(tmp_path):
    """`test_broken_csv_is_refused_with_its_place` has every such place."""
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom size=".1" pos="0 0 -.2"/></body></worldbody></mujoco>'
    )
    rows = [f"{0.01 * i},{0.1 * i},0.0" for i in range(50)]
    rows[20] = "0.2,much,0.0"
    (tmp_path / "run.csv").write_text("t,q,tau\n" + "\n".join(rows) + "\n")
    (tmp_path / "study.toml").write_text(
        'model = "arm.xml"\ntime = "t"\n[[recording]]\nfile = "run.csv"\n'
        '[joints.elbow]\nposition = "q"\ntorque = "tau"\ntorque_kind = "commanded"\n'
    )
    done = gap(str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--json")
    assert done.returncode == 2
    said = json.loads(done.stdout)["error"]["detail"]
    assert "run.csv" in said and "q" in said and "22" in said and "much" in said
