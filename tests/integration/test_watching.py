"""Running trials and robots as people watch them, and failed jobs that operators put back."""

import json
from contextlib import ExitStack

import pytest

from services.dashboard.watch_page import MOST_OF_OWNER, MOST_WATCHING
from tests.integration.farm_process import PATIENCE_S, services, until
from tests.integration.test_dashboard import signed_in, user_token, word


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("watching") / "farm", max_attempts=1) as running:
        yield running


def test_a_running_trial_is_watched_by_its_owner_until_its_end(farm):
    robot = farm.start_robot("robot-live", trial_s=600, live=True)
    ann = user_token(farm, "ann")["secret"]
    job_id = farm.submit(farm.policy(farm.client(ann)), farm.client(ann), trials=1).json()["job_id"]
    trial = f"{job_id}-000"
    until(lambda: farm.robots_in("running") == 1, PATIENCE_S, "the trial to run")
    viewer, stranger = signed_in(farm, ann), signed_in(farm, user_token(farm, "bob")["secret"])
    assert stranger.get(f"/trials/{trial}/watch").status_code == 404
    assert 'id="watch"' in viewer.get(f"/trials/{trial}").text
    times, kinds = [], []
    with viewer.stream("GET", f"/trials/{trial}/watch") as answer:
        for line in answer.iter_lines():
            if line.startswith("event: "):
                kinds.append(line.removeprefix("event: "))
            elif line.startswith("data: ") and kinds[-1] == "state":
                times.append(json.loads(line.removeprefix("data: "))["t_s"])
                if len(times) == 20:
                    farm.admin.post(f"/v1/jobs/{job_id}/cancel")
    assert kinds[-1] == "over" and set(kinds[:-1]) == {"state"}
    assert len(times) >= 20 and times == sorted(times)
    assert times[-1] - times[0] > 1.0
    farm.wait_for_end(job_id)
    robot.terminate()
    robot.wait(PATIENCE_S)


def test_no_more_than_so_many_watch(farm):
    farm.start_robot("robot-long", trial_s=600, live=True)
    job_id = farm.submit(farm.policy(), trials=1).json()["job_id"]
    until(lambda: farm.job(job_id)["trials_running"] == 1, PATIENCE_S, "the trial to run")
    viewers = [
        signed_in(farm, farm.admin.post("/v1/tokens", json={"owner": f"op{n}", "scopes": ["operate"]}).json()["secret"])
        for n in range(4)
    ]
    path = f"/trials/{job_id}-000/watch"
    with ExitStack() as opened:
        for number in range(MOST_WATCHING):
            assert opened.enter_context(viewers[number // MOST_OF_OWNER].stream("GET", path)).status_code == 200
        refused = viewers[3].get(path)
        assert (refused.status_code, refused.json()["type"]) == (429, "/problems/too-many-watching")

    def may_again():
        with viewers[3].stream("GET", path) as answer:
            return answer.status_code == 200

    until(may_again, PATIENCE_S, "viewers who left to be forgotten")
    farm.admin.post(f"/v1/jobs/{job_id}/cancel")
    farm.wait_for_end(job_id)
    farm.robots["robot-long"].terminate()
    farm.robots["robot-long"].wait(PATIENCE_S)


def test_robots_tell_how_they_are_and_temperatures_only_to_operators(farm):
    user = user_token(farm, "carl")["secret"]
    for_operators, for_users = (
        client.get("/v1/robots/robot-long").json()["health"] for client in (farm.admin, farm.client(user))
    )
    assert for_operators == {
        "motor_temperature_rise_k": 12.3,
        "tracker_confidence": 0.91,
        "self_test": {"at": "2026-01-01T00:00:00+00:00", "wrong": None},
    }
    assert for_users == for_operators | {"motor_temperature_rise_k": None}
    until(lambda: farm.robots_in("lost") == len(farm.robots), PATIENCE_S, "the robots to be missed")
    assert "12 K" not in signed_in(farm, farm.tokens["admin"]).get("/").text, "what a lost robot said last is not how it is"
    farm.start_robot("robot-long", trial_s=600, live=True)
    until(lambda: "12 K" in signed_in(farm, farm.tokens["admin"]).get("/").text, PATIENCE_S, "the robot to be back")
    own, others = (signed_in(farm, token).get("/").text for token in (farm.tokens["admin"], user))
    assert "12 K" in own and "0.91" in own and "passed" in own
    assert "12 K" not in others and "0.91" in others
    farm.robots["robot-long"].terminate()
    farm.robots["robot-long"].wait(PATIENCE_S)


def test_an_operator_puts_a_failed_job_back(farm):
    broken = farm.start_robot("robot-broken", trial_s=0.02, fail=True)
    ann = user_token(farm, "ann")["secret"]
    job_id = farm.submit(farm.policy(farm.client(ann)), farm.client(ann), trials=3).json()["job_id"]
    assert farm.wait_for_end(job_id)["state"] == "failed"
    broken.terminate()
    broken.wait(PATIENCE_S)
    # One that has not been missed yet would be given a trial, which then fails.
    until(lambda: farm.robots_in("lost") == len(farm.robots), PATIENCE_S, "the robots to be missed")
    owner, operator = signed_in(farm, ann), signed_in(farm, farm.tokens["admin"])
    assert "Queue again" not in owner.get(f"/jobs/{job_id}").text
    assert owner.post(f"/jobs/{job_id}/requeue", data={"csrf": word(owner)}).status_code == 403
    assert farm.client(ann).post(f"/v1/jobs/{job_id}/requeue").status_code == 403
    assert "Queue again" in operator.get(f"/jobs/{job_id}").text
    assert operator.post(f"/jobs/{job_id}/requeue", data={"csrf": word(operator)}).status_code == 303
    farm.start_robot("robot-good", trial_s=0.02)
    job = farm.wait_for_end(job_id)
    assert (job["state"], job["trials_done"], job["platform_faults"]) == ("succeeded", 3, 1)
    assert operator.post(f"/jobs/{job_id}/requeue", data={"csrf": word(operator)}).status_code == 409
    events = [
        json.loads(line[6:])
        for line in farm.admin.get(f"/v1/jobs/{job_id}/events").text.splitlines()
        if line.startswith("data: ")
    ]
    assert [event["kind"] for event in events if event["kind"].startswith("job_")][-1] == "job_ended"


def test_webhooks_are_off_unless_the_operator_allows_them(farm):
    answer = farm.submit(farm.policy(), webhook="https://a.example/")
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/webhooks-off")
