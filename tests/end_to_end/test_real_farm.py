"""Farms whose robots differ: hidden physics stays hidden, sick robots leave, objects and identification go the same way."""

import json
from pathlib import Path

import pytest

from api_schemas.trial_log_reader import read_log
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.replay import EXIT_DIFFERS
from tests.end_to_end.farm import Farm

ROOT = Path(__file__).parent.parent.parent
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
STUCK = "robot-1:stuck_joint:finger120_upper_to_middle@1"
DEAD = "robot-2:dead_camera:camera180@1"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    """Robot 0 stays well; from their second trials on robot 1 has a stuck joint and robot 2 a dead camera."""
    more = ("--physics", "real", "--farm-seed", "99", "--fault", STUCK, "--fault", DEAD)
    with Farm(tmp_path_factory.mktemp("real"), robots=3, more=more) as farm:
        yield farm


@pytest.fixture(scope="module")
def job(farm) -> str:
    job = farm.submit(REFERENCE, trials=20, seed=7)
    farm.run("watch", job)
    return job


def test_sick_robots_leave_with_a_reason_and_their_trials_run_elsewhere(farm, job):
    report = farm.report(job)
    assert len(report["per_trial"]) == 20 and report["policy_faults"] == 0
    robots = {robot["robot"]: robot for robot in farm.json("robots")["robots"]}
    assert robots["robot-0"]["state"] == "idle"
    assert robots["robot-1"]["state"] == robots["robot-2"]["state"] == "out_of_service"
    assert "finger120_upper_to_middle" in robots["robot-1"]["reason"]
    assert "camera180" in robots["robot-2"]["reason"]
    assert {fault["robot"] for fault in report["platform_fault_attempts"]} == {"robot-1", "robot-2"}
    assert report["platform_faults"] == 2
    tried = [row["robot"] for row in report["per_trial"]]
    assert max(tried.count("robot-1"), tried.count("robot-2")) <= 6, "one self-test every five trials"
    assert report["between_robots"] is not None
    assert not farm.json("status")["healthy"]


def test_a_log_holds_nothing_that_is_hidden(farm, job, tmp_path):
    farm.run("fetch", job, "--to", str(tmp_path))
    data = (tmp_path / "trial-000.mcap").read_bytes()
    log = read_log(tmp_path / "trial-000.mcap")
    assert not any(topic.startswith("/truth") for topic in log.message_counts)
    assert log.metadata["physics"] == "real"
    text = json.dumps([log.metadata, log.outcome])
    assert not any(key in text or key.encode() in data for key in PARAMETERS)
    assert (log.confidence < 1.0).any()
    assert farm.json("replay", str(tmp_path / "trial-000.mcap"), "--verify")["same"]


def test_a_forged_log_is_found_out_by_the_server(farm, job, tmp_path):
    farm.run("fetch", job, "--to", str(tmp_path))
    wrong = tmp_path / "trial-001.mcap"
    shown = read_log(wrong)
    other = tmp_path / "trial-002.mcap"
    assert shown.metadata["trial_id"] != read_log(other).metadata["trial_id"]
    forged = other.read_bytes().replace(b"-002", b"-001")
    (tmp_path / "forged.mcap").write_bytes(forged)
    farm.run("replay", str(tmp_path / "forged.mcap"), "--verify", code=None)
    assert farm.json("replay", str(wrong), "--verify")["same"]
    assert EXIT_DIFFERS == 6


def test_truth_is_for_operators(farm, job, tmp_path):
    user = farm.json("token", "create", "--owner", "ada", "--scope", "submit")["secret"]
    farm.run("fetch", job, "--to", str(tmp_path / "all"), "--truth")
    assert len(list((tmp_path / "all").glob("*.truth.mcap"))) == 20
    before, farm.env = farm.env, farm.env | {"TRIFARM_TOKEN": user}
    try:
        farm.run("fetch", job, "--to", str(tmp_path / "mine"), "--truth", code=None)
        assert not list((tmp_path / "mine").glob("*.truth.mcap"))
    finally:
        farm.env = before


def test_an_operator_may_look_and_sees_what_the_seed_gives(farm):
    folder = str(farm.folder / "data")
    seen = farm.json("physics", "--robot", "robot-0", "--data", folder, "--farm-seed", "99")
    assert set(seen["effects"]) and seen["robot"] == "robot-0"
    again = farm.json("physics", "--robot", "robot-1", "--data", folder, "--farm-seed", "99")
    assert seen["effects"] != again["effects"]


@pytest.mark.parametrize("kind", ["cuboid", "sphere", "octagonal_prism"])
def test_other_objects_go_the_same_way(farm, kind):
    job = farm.json("submit", str(REFERENCE), "--task", "push", "--trials", "2", "--seed", "3", "--object", kind)["job_id"]
    report = farm.report(job)
    assert report["object"] == kind and report["policy_faults"] == 0 and len(report["per_trial"]) == 2


def test_identification_brings_logs_of_every_excitation(farm, tmp_path):
    done = farm.json("identify", "--robot", "any", "--to", str(tmp_path), "--wait")
    logs = sorted(tmp_path.glob("*.mcap"))
    assert len(logs) == 7
    excitations = {read_log(log).metadata["excitation"] for log in logs}
    assert excitations == {
        "slow_ramps", "fast_sweeps", "chirps", "joint_limits", "oscillations", "hold_poses", "slide_cube",
    }  # fmt: skip
    assert done
