"""The walk of one job through real services on each home: real databases, real zenoh, real processes, a scripted robot."""

import json
import re
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest
import yaml

from api_schemas.report import Report
from tests.homes import scale_settings
from tests.integration.farm_process import PATIENCE_S, services, sha256, until
from tests.stalls import stalls


@pytest.fixture(scope="module", params=["embedded", "scale"])
def farm(request, tmp_path_factory):
    scale = request.param == "scale"
    homes = scale_settings(*(request.getfixturevalue(name) for name in ("postgres", "s3"))) if scale else {}
    with services(tmp_path_factory.mktemp("walk") / "farm", **homes) as running:
        running.start_robots(4, trial_s=0.02, log_bytes=20_000)
        yield running


@pytest.fixture(scope="module")
def policy(farm):
    return farm.policy()


@pytest.fixture(scope="module")
def done(farm, policy):
    """A job of 40 trials that has ended."""
    job_id = farm.submit(policy, trials=40).json()["job_id"]
    assert farm.wait_for_end(job_id)["state"] == "succeeded"
    return job_id


def test_forty_trials_give_forty_accepted_outcomes_and_a_report(farm, done):
    report = Report.model_validate_json(farm.admin.get(f"/v1/jobs/{done}/report").content)
    assert (report.trials, len(report.per_trial), report.attempts, report.platform_faults) == (40, 40, 40, 0)
    assert [row.trial for row in report.per_trial] == list(range(40))
    assert report.successes == sum(row.seed % 4 != 0 for row in report.per_trial)
    assert [row.trials for row in report.per_robot] == [10, 10, 10, 10]


def test_the_report_never_changes(farm, done):
    one, other = (farm.admin.get(f"/v1/jobs/{done}/report") for _ in range(2))
    assert one.content == other.content
    assert one.headers["etag"] == f'"{sha256(one.content)}"'
    assert f"job {done}" in farm.admin.get(f"/v1/jobs/{done}/report/text").text


def test_same_seed_same_trials_and_same_outcomes(farm, policy, done):
    again = farm.submit(policy, trials=40).json()["job_id"]
    farm.wait_for_end(again)
    rows = [
        [(row["seed"], row["outcome"]["kind"]) for row in farm.admin.get(f"/v1/jobs/{job}/report").json()["per_trial"]]
        for job in (done, again)
    ]
    assert rows[0] == rows[1]


def test_a_log_is_served_whole_in_parts_and_not_again(farm, done):
    trial = farm.admin.get(f"/v1/jobs/{done}/trials").json()["trials"][7]
    path = f"/v1/trials/{trial['trial_id']}/log"
    whole = farm.admin.get(path)
    assert sha256(whole.content) == trial["log_sha256"]
    assert len(whole.content) == trial["log_bytes"] == 20_008
    part = farm.admin.get(path, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, whole.content[100:200])
    assert part.headers["content-range"] == "bytes 100-199/20008"
    assert farm.admin.get(path, headers={"Range": "bytes=-8"}).content == whole.content[-8:]
    assert farm.admin.get(path, headers={"Range": "bytes=20000-"}).content == whole.content[20_000:]
    assert farm.admin.get(path, headers={"Range": "bytes=20008-"}).status_code == 416
    assert farm.admin.get(path, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304
    head = farm.admin.head(path)
    assert (head.status_code, head.headers["content-length"], head.content) == (200, "20008", b"")


def test_the_history_streams_and_resumes_without_gap_or_repeat(farm, done):
    events = read_events(farm, done)
    ids = [int(event["id"]) for event in events]
    assert ids == list(range(1, len(ids) + 1))
    assert events[0]["event"] == "job_queued"
    assert events[-1]["event"] == "job_ended"
    assert sum(event["event"] == "trial_done" for event in events) == 40
    assert json.loads(events[-1]["data"])["trials_done"] == 40
    rest = read_events(farm, done, after=ids[50])
    assert [event["id"] for event in rest] == [event["id"] for event in events[51:]]
    assert read_events(farm, done, after=ids[-1]) == []
    history = farm.admin.get(f"/v1/jobs/{done}/history", params={"after": ids[-1] - 2}).json()
    assert [event["id"] for event in history] == ids[-2:]


def read_events(farm, job_id, after=None):
    headers = {} if after is None else {"Last-Event-ID": str(after)}
    with farm.admin.stream("GET", f"/v1/jobs/{job_id}/events", headers=headers) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        text = answer.read().decode()
    blocks = [block for block in text.split("\n\n") if block and not block.startswith(":")]
    return [dict(line.split(": ", 1) for line in block.split("\n")) for block in blocks]


def test_a_live_stream_ends_with_the_job(farm, policy):
    with stalls() as stalled:
        job_id = farm.submit(policy, trials=8).json()["job_id"]
        events = read_events(farm, job_id)
        read_at = datetime.now(UTC)
    assert events[-1]["event"] == "job_ended"
    # Events are gathered for 0.1 s before they are sent; a stream that looked only now and then would be 2 s late.
    late = read_at - datetime.fromisoformat(json.loads(events[-1]["data"])["at"])
    assert late < timedelta(seconds=1 + stalled.seconds)
    assert len({event["id"] for event in events}) == len(events)


def test_an_idempotency_key_makes_one_job(farm, policy):
    key = {"Idempotency-Key": "one-key"}
    first, second = (farm.submit(policy, headers=key, seed=None) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json()["job_id"] == second.json()["job_id"]
    assert first.headers["location"] == f"/v1/jobs/{first.json()['job_id']}"
    other = farm.submit(policy, headers=key, trials=5)
    assert (other.status_code, other.json()["type"]) == (409, "/problems/idempotency-key-reused")
    assert other.headers["content-type"] == "application/problem+json"


FEEDS = {"/v1/jobs/{job_id}/history": "waits for what is new; its key is the event's own number"}
"""What answers with a list of events and is no list of things that are there."""


def lists_of(document):
    """The routes of the API's document that give many of something, with the name of their entries."""
    schemas = document["components"]["schemas"]
    for path, operations in document["paths"].items():
        content = operations.get("get", {}).get("responses", {}).get("200", {}).get("content", {})
        schema = content.get("application/json", {}).get("schema", {})
        members = schemas.get(schema.get("$ref", "").rpartition("/")[2], {}).get("properties", {})
        many = [name for name, member in members.items() if member.get("type") == "array"]
        if schema.get("type") == "array" or (len(many) == 1 and set(members) <= {*many, "next_cursor"}):
            yield path, (many or [None])[0]


def test_every_list_comes_in_pages(farm, policy, done):
    ladder = {"name": "two", "task": "push", "rungs": [{"step": step, "policy": policy} for step in (1, 2)], "trials": 1}
    for _ in range(3):
        assert farm.admin.post("/v1/ladders", json=ladder).status_code == 201
    found = {path: name for path, name in lists_of(farm.admin.get("/openapi.json").json()) if path not in FEEDS}
    assert set(found) >= {"/v1/jobs", "/v1/robots", "/v1/policies", "/v1/ladders", "/v1/tokens", "/v1/jobs/{job_id}/trials"}
    for path, name in found.items():
        if path == "/v1/leaderboard":
            continue  # one entry a task and physics
        address = path.replace("{job_id}", done)
        whole = farm.admin.get(address, params={"limit": 200}).json()
        assert whole["next_cursor"] is None
        seen, cursor, pages = [], None, 0
        while cursor is not None or not pages:
            page = farm.admin.get(address, params={"limit": 2} | ({"cursor": cursor} if cursor else {})).json()
            seen, cursor, pages = seen + page[name], page["next_cursor"], pages + 1
        assert [identity(each) for each in seen] == [identity(each) for each in whole[name]], path
        assert pages == max(1, -(-len(seen) // 2)), path
        for wrong in ({"cursor": "bi0x"}, {"cursor": "x"}, {"limit": 0}, {"limit": 10**6}):
            assert farm.admin.get(address, params=wrong).status_code == 422, (path, wrong)


def identity(entry):
    return next(entry[key] for key in ("trial_id", "job_id", "ladder_id", "digest", "token_id", "robot") if key in entry)


def test_a_drained_robot_takes_no_trial_until_it_is_resumed(farm, policy):
    until(lambda: farm.robots_in("idle") == 4, PATIENCE_S, "the robots to be done with the job before")
    assert farm.admin.post("/v1/robots/robot-2/drain").json()["state"] == "draining"
    job_id = farm.submit(policy, trials=8, seed=3).json()["job_id"]
    farm.wait_for_end(job_id)
    report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
    assert {row["robot"] for row in report["per_robot"]} == {"robot-0", "robot-1", "robot-3"}
    departed = [row["departure"] for row in report["per_trial"] if row["departure"]]
    assert len(departed) == 2
    assert all(why.startswith("robot-2 is draining") for why in departed), "it may still end the trial before"
    assert report["platform_faults"] == 0
    farm.admin.post("/v1/robots/robot-2/resume")
    until(lambda: farm.robots_in("idle") == 4, PATIENCE_S, "robot-2 to be idle again")


def test_status_metrics_and_health(farm):
    farm.admin.post("/v1/robots/robot-2/resume")  # where the test before ended early
    until(lambda: farm.robots_in("idle") == 4, PATIENCE_S, "all robots to be idle")
    status = farm.admin.get("/v1/status").json()
    assert status["healthy"], status
    assert status["robots_by_state"]["idle"] == 4
    assert httpx.get(f"{farm.api}/healthz").json()["status"] == "ok"
    metrics = httpx.get(f"{farm.api}/metrics").text
    assert 'trifarm_robots{state="idle"} 4.0' in metrics
    assert "trifarm_leases_total" in metrics
    ended = 'trifarm_attempts_total{fault="none"} '
    before = float(metrics.partition(ended)[2].split()[0])
    farm.wait_for_end(farm.submit(farm.policy(), trials=3, seed=9).json()["job_id"])
    assert f"{ended}{before + 3}" in httpx.get(f"{farm.api}/metrics").text


def test_dashboard_and_alert_rules_ask_for_metrics_that_there_are(farm):
    httpx.get(f"{farm.api}/v1/jobs/none")  # a problem, so that there is one to count
    metrics = httpx.get(f"{farm.api}/metrics").text
    known = set(re.findall(r"^([a-z_]+)[ {]", metrics, re.MULTILINE))
    deploy = Path(__file__).parents[2] / "deploy"
    panels = json.loads((deploy / "grafana/trifarm.json").read_text())["panels"]
    questions = [each["expr"] for panel in panels for each in panel["targets"]]
    rules = yaml.safe_load((deploy / "prometheus/alerts.yaml").read_text())["groups"][0]["rules"]
    for asked_by in (questions, [rule["expr"] for rule in rules]):
        asked = set(re.findall(r"(?:trifarm|process)_[a-z_]+", " ".join(asked_by)))
        assert len(asked) >= 8
        assert asked <= known


def test_physics_and_learning_are_never_loaded(farm):
    loaded = Path(f"/proc/{farm.process.pid}/maps").read_text()
    assert "mujoco" not in loaded
    assert "libtorch" not in loaded
    assert "onnxruntime" not in loaded


def test_sigterm_ends_everything_within_five_seconds(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(1, trial_s=600)
        job_id = farm.submit(farm.policy(), trials=2).json()["job_id"]
        with farm.admin.stream("GET", f"/v1/jobs/{job_id}/events"):
            until(lambda: farm.job(job_id)["state"] == "running", PATIENCE_S, "the job to run")
            began = time.monotonic()
            with stalls() as stalled:
                assert farm.stop() == 0
            assert time.monotonic() - began < 5 + stalled.seconds
