"""Robots that differ, as the services see them: identifications, truth that is not for everybody, robots out of service."""

import itertools
import socket
import time

import pytest

from api_schemas.excitation import ExcitationName
from api_schemas.report import BetweenRobots, IdentificationReport, Report
from api_schemas.robot import Lease
from services.api.truth import MCAP_MAGIC
from tests.integration.farm_process import PATIENCE_S, services, sha256, until
from tests.integration.test_services_access import user

REASON = "joint 4 does not follow its path by 0.31 rad"


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden") / "farm"
    with services(folder, physics="/secret/place/stiff.toml", whys_per_robot="1") as running:
        running.start_robots(3, trial_s=0.02, truth=True)
        yield running


@pytest.fixture(scope="module")
def done(farm):
    """A job of 30 trials with another object, and its trials."""
    job_id = farm.submit(farm.policy(), trials=30, object="sphere", object_scale=0.8).json()["job_id"]
    assert farm.wait_for_end(job_id)["state"] == "succeeded"
    return job_id, farm.admin.get(f"/v1/jobs/{job_id}/trials").json()["trials"]


def test_the_physics_is_shown_by_name_alone(farm):
    assert farm.admin.get("/v1/status").json()["physics"] == "file:stiff"


def test_the_object_of_a_job_reaches_its_robots_and_its_report(farm, done):
    job_id, trials = done
    assert (farm.job(job_id)["object"], farm.job(job_id)["object_scale"]) == ("sphere", 0.8)
    lease = Lease.model_validate_json(farm.admin.get(f"/v1/jobs/{job_id}/trials/3/truth").content)
    assert (lease.object, lease.object_scale, lease.trial_id, lease.excitation) == ("sphere", 0.8, trials[3]["trial_id"], None)
    report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
    assert (report["object"], report["object_scale"]) == ("sphere", 0.8)
    assert "object sphere, 0.8 x its usual size" in farm.admin.get(f"/v1/jobs/{job_id}/report/text").text


@pytest.mark.parametrize("wrong", [{"object": "teapot"}, {"object_scale": 1.3}, {"object_scale": 0.5}, {"task": "identify"}])
def test_what_no_robot_can_do_is_refused(farm, wrong):
    answer = farm.submit("0" * 64, **wrong)
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/invalid-request")


def test_the_report_says_how_much_lies_between_robots(farm, done):
    report = Report.model_validate_json(farm.admin.get(f"/v1/jobs/{done[0]}/report").content)
    assert isinstance(report.between_robots, BetweenRobots)
    low, high = report.between_robots.interval_80
    assert 0 <= low <= report.between_robots.variance_share <= high <= 1
    assert report.between_robots.robots == 3
    assert "between robots: " in farm.admin.get(f"/v1/jobs/{done[0]}/report/text").text


def test_truth_is_for_operators_alone(farm, done):
    job_id, trials = done
    assert all(trial["has_truth"] for trial in trials)
    path = f"/v1/jobs/{job_id}/trials/0/truth"
    (_, operator), (_, ann), (_, robot) = (user(farm, *who) for who in (("op", "operate"), ("ann", "submit"), ("r", "robot")))
    whole = operator.get(path)
    assert whole.headers["etag"] == f'"{sha256(whole.content)}"'
    assert operator.get(path, headers={"Range": "bytes=10-19"}).content == whole.content[10:20]
    head = operator.head(path)
    assert (head.headers["etag"], int(head.headers["content-length"])) == (whole.headers["etag"], len(whole.content))
    own = farm.submit(farm.policy(ann), client=ann, trials=1).json()["job_id"]
    farm.wait_for_end(own)
    for client in (ann, robot):
        for job in (own, job_id):
            assert client.get(f"/v1/jobs/{job}/trials/0/truth").status_code == 403
    digest = sha256(whole.content)
    for shown in (f"/v1/jobs/{job_id}/trials", f"/v1/trials/{job_id}-000", f"/v1/jobs/{job_id}/report"):
        assert digest not in operator.get(shown).text
    assert operator.get(f"/v1/jobs/{job_id}/trials/30/truth").json()["type"] == "/problems/trial-not-found"
    assert operator.get(f"/v1/jobs/{job_id}/trials/-1/truth").status_code == 422


def test_only_the_owner_and_operators_may_have_a_log_verified(farm, done):
    (_, ann), (_, bob) = user(farm, "ann2", "submit"), user(farm, "bob2", "submit")
    own = farm.submit(farm.policy(ann), client=ann, trials=1).json()["job_id"]
    farm.wait_for_end(own)
    assert bob.post(f"/v1/jobs/{own}/trials/0/verify", content=b"log").status_code == 404
    # What a scripted robot sends is no log, and the replay says so; nobody else is any the wiser.
    for client, content in ((ann, MCAP_MAGIC + b"log"), (farm.admin, b"log")):
        answer = client.post(f"/v1/jobs/{own}/trials/0/verify", content=content)
        assert (answer.status_code, answer.json()["type"]) == (422, "/problems/log-unfit"), answer.text


def test_whoever_sends_a_log_slowly_holds_up_nobody_else(farm, done):
    path = f"/v1/jobs/{done[0]}/trials/0/verify"
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {farm.tokens['admin']}\r\nContent-Length: 9\r\n\r\n"
    with socket.create_connection(("127.0.0.1", farm.port)) as slow:
        slow.sendall(head.encode() + b"l")
        time.sleep(0.5)  # its body's first byte is there, and the others never come
        answer = farm.admin.post(path, content=MCAP_MAGIC + b"log")
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/log-unfit"), answer.text


def test_a_log_to_verify_is_no_larger_than_logs_of_its_trial_can_be(farm, done):
    path, stored = f"/v1/jobs/{done[0]}/trials/0/verify", len(farm.admin.get(f"/v1/trials/{done[0]}-000/log").content)
    answer = farm.admin.post(path, content=bytes(2 * stored + 1024**2 + 1))
    assert (answer.status_code, answer.json()["type"]) == (413, "/problems/file-too-large")


def test_a_truth_that_has_gone_from_the_store_is_not_found(farm):
    job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
    farm.wait_for_end(job_id)
    path = f"/v1/jobs/{job_id}/trials/0"
    digest = farm.admin.get(f"{path}/truth").headers["etag"].strip('"')
    (farm.data / "files" / "sha256" / digest[:2] / digest).unlink()
    for answer in (farm.admin.get(f"{path}/truth"), farm.admin.post(f"{path}/verify", content=b"log")):
        assert (answer.status_code, answer.json()["type"]) == (404, "/problems/file-not-found")


def test_what_the_farm_keeps_is_for_its_user_alone(farm, done):
    kept = [path for path in farm.data.rglob("*") if path.is_file()]
    assert len(kept) > 60
    assert not [path for path in kept if path.stat().st_mode & 0o077]


def test_an_identification_ends_when_its_robot_stays_away(tmp_path):
    with services(tmp_path / "farm", pinned_robot_gone_s=1.0, renew_every_s=1.0) as farm:
        farm.start_robots(1, trial_s=0.3)
        job_id = farm.identify(repeats=20).json()["job_id"]
        until(lambda: farm.job(job_id)["trials_done"] >= 1, PATIENCE_S, "the first recording")
        farm.robots["robot-0"].terminate()
        job = farm.wait_for_end(job_id)
        assert (job["state"], job["robot"]) == ("failed", "robot-0")
        assert "could run on robot-0 alone, which has been silent for" in job["reason"]
        assert farm.admin.get(f"/v1/trials/{job_id}-000/log").status_code == 200


def test_an_outcome_can_name_no_other_truth_than_its_own(tmp_path):
    with services(tmp_path / "farm", lease_s=600) as farm:
        farm.start_robots(1, trial_s=600, renew_s=600)
        job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
        until(lambda: farm.job(job_id)["trials_running"] == 1, PATIENCE_S, "the trial to run")
        robot, lease = farm.robot_client("robot-0"), f"/v1/leases/{job_id}-000/1"
        log = robot.put(f"{lease}/log", content=b"log").json()["sha256"]
        outcome = {"kind": "failed", "fault": "none", "reason": "missed"}
        body = {"robot": "robot-0", "fence": 1, "outcome": outcome, "log_sha256": log}
        path = f"/v1/leases/{job_id}-000/outcome"
        assert robot.post(path, json=body | {"truth_sha256": "0" * 64}).json()["type"] == "/problems/truth-missing"
        truth = robot.put(f"{lease}/truth", content=b"truth").json()["sha256"]
        assert robot.post(path, json=body | {"truth_sha256": log}).json()["type"] == "/problems/truth-missing"
        wrong = body | {"outcome": outcome | {"kind": "recorded"}}
        assert robot.post(path, json=wrong).json()["type"] == "/problems/wrong-outcome"
        assert robot.post(path, json=body | {"truth_sha256": truth}).status_code == 200
        assert robot.put(f"{lease}/truth", content=b"late").json()["type"] == "/problems/stale-fence"
        farm.wait_for_end(job_id)
        assert farm.admin.get(f"/v1/jobs/{job_id}/trials/0/truth").content == b"truth"


def test_without_a_truth_there_is_none_to_fetch_or_to_verify_with(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robots(1)
        job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
        farm.wait_for_end(job_id)
        assert not farm.admin.get(f"/v1/trials/{job_id}-000").json()["has_truth"]
        answers = farm.admin.get(f"/v1/jobs/{job_id}/trials/0/truth"), farm.admin.post(f"/v1/jobs/{job_id}/trials/0/verify")
        for answer in answers:
            assert (answer.status_code, answer.json()["type"]) == (404, "/problems/truth-not-found")


def test_an_identification_records_every_excitation_on_one_robot(farm):
    _, ann = user(farm, "ann3", "submit")
    key = {"Idempotency-Key": "once"}
    made, again = (farm.identify(client=ann, headers=key, repeats=2, seed=4) for _ in range(2))
    assert (made.status_code, again.status_code, made.json()["job_id"]) == (201, 200, again.json()["job_id"])
    job_id = made.json()["job_id"]
    job = farm.wait_for_end(job_id)
    assert (job["state"], job["task"], job["trials_done"], job["policy"], job["successes"]) == (
        "succeeded",
        "identify",
        2 * len(ExcitationName),
        None,
        0,
    )
    report = IdentificationReport.model_validate_json(ann.get(f"/v1/jobs/{job_id}/report").content)
    assert {row.robot for row in report.per_trial} == {report.robot} == {job["robot"]}
    assert [row.excitation for row in report.per_trial] == list(ExcitationName) * 2
    text = ann.get(f"/v1/jobs/{job_id}/report/text").text
    assert f"{2 * len(ExcitationName)} excitations recorded on {report.robot}" in text
    assert "success" not in text
    for row in report.per_trial:
        assert sha256(ann.get(f"/v1/trials/{row.trial_id}/log").content) == row.log_sha256
    lease = Lease.model_validate_json(farm.admin.get(f"/v1/jobs/{job_id}/trials/9/truth").content)
    second = list(ExcitationName)[9 - len(ExcitationName)]
    assert (lease.task, lease.excitation, lease.policy, lease.manifest) == ("identify", second, None, None)


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"robot": "robot-9"}, 404),
        ({"robot": "Robot 1"}, 422),
        ({"excitations": []}, 422),
        ({"excitations": ["dance"]}, 422),
        ({"excitations": ["chirps", "chirps"]}, 422),
        ({"repeats": 0}, 422),
        ({"repeats": 21}, 422),
        ({"policy": "0" * 64}, 422),
    ],
)
def test_an_identification_that_cannot_be_is_refused(farm, body, status):
    assert farm.identify(**body).status_code == status


def test_a_robot_out_of_service_costs_the_policy_nothing_and_comes_back_when_resumed(tmp_path):
    with services(tmp_path / "farm") as farm:
        farm.start_robot("robot-0", trial_s=0.02, breaks=REASON)
        farm.start_robot("robot-1", trial_s=0.02)
        until(lambda: farm.robots_in("idle") == 2, PATIENCE_S, "both robots")
        job_id = farm.submit(farm.policy(), trials=6).json()["job_id"]
        assert farm.wait_for_end(job_id)["state"] == "succeeded"
        report = farm.admin.get(f"/v1/jobs/{job_id}/report").json()
        assert {row["robot"] for row in report["per_trial"]} == {"robot-1"}
        assert (report["platform_faults"], report["policy_faults"], report["trials"]) == (1, 0, 6)
        robot = farm.admin.get("/v1/robots/robot-0").json()
        assert (robot["state"], robot["reason"]) == ("out_of_service", REASON)
        assert any(REASON in problem for problem in farm.admin.get("/v1/status").json()["problems"])
        pinned = farm.identify(robot="robot-0", excitations=["chirps"]).json()
        assert pinned["waiting_because"] == f"1 trial must run on robot-0, which is out of service ({REASON})"
        farm.admin.post("/v1/robots/robot-0/resume")
        assert farm.wait_for_end(pinned["job_id"])["state"] == "succeeded"
        assert farm.admin.get("/v1/robots/robot-0").json()["reason"] is None


def test_beyond_the_questions_of_a_robot_a_user_is_refused_and_told_why(farm):
    _, ann = user(farm, "asks", "submit")
    job = farm.submit(farm.policy(ann), client=ann, trials=40).json()["job_id"]
    farm.wait_for_end(job)
    trials = ann.get(f"/v1/jobs/{job}/trials").json()["trials"]
    failed = [trial for trial in trials if trial["outcome"]["kind"] == "failed"]
    first, again = next(pair for pair in itertools.combinations(failed, 2) if pair[0]["robot"] == pair[1]["robot"])
    path, beyond = (f"/v1/jobs/{job}/trials/{trial['ordinal']}/why" for trial in (first, again))
    assert ann.post(path).json()["questions_left"] == 0
    refused = ann.post(beyond)
    problem = refused.json()
    assert (refused.status_code, problem["type"], problem["limit"]) == (429, "/problems/why-budget-used", 1)
    assert first["robot"] in problem["detail"]
    assert "hidden physics" in problem["detail"]
    assert int(refused.headers["retry-after"]) > 86_400
    assert ann.get(beyond).json()["type"] == "/problems/why-not-asked"
    assert ann.post(path).status_code == 200, "what was asked is not asked again"
    assert farm.admin.post(beyond).status_code == 200
    assert ann.post(beyond).status_code == 429, "what an operator had answered costs a question, too"
