"""Several processes of the services on one PostgreSQL database and one S3 server: whoever is asked, it is one farm."""

import os
import re
import secrets
import signal
import subprocess
import sys
from contextlib import contextmanager

import httpx
import pytest

from services.api.door import SESSION_COOKIE as COOKIE
from tests.homes import scale_settings
from tests.integration.farm_process import PATIENCE_S, ROOT, Services, free_port, services, until

METRICS_PORT = free_port()
"""Of the dispatcher alone."""


@pytest.fixture(scope="module")
def pair(postgres, s3, tmp_path_factory):
    """An API without dispatcher, an API with one, a dispatcher alone, and two robots at each API: (first, second)."""
    shared = {"renew_every_s": 0.5, "farm_key": secrets.token_hex(32)}
    folder, settings = tmp_path_factory.mktemp("many"), scale_settings(postgres, s3) | shared
    with services(folder / "first", dispatches="false", **settings) as first:
        second = Services(folder / "second", bus_connect=first.bus, **settings)
        second.tokens = first.tokens
        try:
            second.start()
            with dispatcher(folder / "third", second.settings):
                for number, each in enumerate((first, first, second, second)):
                    each.bus = first.bus
                    each.start_robot(f"robot-{number}", trial_s=0.1)
                for each in (first, second):
                    until(lambda farm=each: farm.robots_in("idle") == 4, PATIENCE_S, "four idle robots")
                yield first, second
        finally:
            second.close()


@contextmanager
def dispatcher(data, settings):
    """A dispatcher alone; it ends in good order."""
    command = [sys.executable, "-m", "services", "dispatch", "--data", str(data), "--metrics-port", str(METRICS_PORT)]
    said = data.parent / "third.txt"
    with said.open("wb") as errors:
        process = subprocess.Popen(command, cwd=ROOT, env=os.environ | settings, stderr=errors)
    try:
        until(lambda: '"dispatching"' in said.read_text(), PATIENCE_S, "the dispatcher")
        yield
    finally:
        process.terminate()
        assert process.wait(PATIENCE_S) == 0, said.read_text()


def test_what_one_takes_the_other_shows_and_all_robots_work(pair):
    first, second = pair
    job_id = first.submit(first.policy(), trials=20).json()["job_id"]
    with second.admin.stream("GET", f"/v1/jobs/{job_id}/events") as answer:
        ids = [int(line.removeprefix("id: ")) for line in answer.iter_lines() if line.startswith("id: ")]
    assert ids == list(range(1, len(ids) + 1))
    reports = [each.admin.get(f"/v1/jobs/{job_id}/report") for each in pair]
    assert reports[0].content == reports[1].content
    report = reports[0].json()
    assert (report["trials"], report["attempts"], report["platform_faults"]) == (20, 20, 0)
    assert [row["trials"] for row in report["per_robot"]] == [5, 5, 5, 5]
    trial = second.admin.get(f"/v1/jobs/{job_id}/trials").json()["trials"][0]
    logs = [each.admin.get(f"/v1/trials/{trial['trial_id']}/log").content for each in pair]
    assert len(logs[0]) > 0
    assert logs[0] == logs[1]
    done = [{row["robot"]: row["trials_done"] for row in each.admin.get("/v1/robots").json()["robots"]} for each in pair]
    until(
        lambda: [row["trials_done"] for row in second.admin.get("/v1/robots").json()["robots"]] == [5] * 4, PATIENCE_S, str(done)
    )


def test_one_of_two_dispatchers_gives_all_leases_and_says_so(pair):
    def told(name):
        """By each process that could give leases."""
        asked = (f"{pair[1].api}/metrics", f"http://127.0.0.1:{METRICS_PORT}/metrics")
        texts = [httpx.get(address, trust_env=False).text for address in asked]
        return [float(re.search(rf"^{name} (.+)$", each, re.MULTILINE)[1]) for each in texts]

    leads, before = told("trifarm_leads"), told("trifarm_leases_total")
    job_id = pair[0].submit(pair[0].policy(), trials=20).json()["job_id"]
    assert pair[0].wait_for_end(job_id)["state"] == "succeeded"
    given = [now - then for now, then in zip(told("trifarm_leases_total"), before, strict=True)]
    assert sorted(leads) == [0.0, 1.0]
    assert given == [20 * each for each in leads]


def test_a_dispatcher_says_which_port_it_cannot_have(pair, tmp_path):
    command = [sys.executable, "-m", "services", "dispatch", "--data", str(tmp_path), "--metrics-port", str(METRICS_PORT)]
    ended = subprocess.run(command, cwd=ROOT, env=os.environ | pair[1].settings, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert f"nothing can listen on 127.0.0.1:{METRICS_PORT}, TRIFARM_METRICS_PORT: " in ended.stderr.splitlines()[-1]


def test_a_wish_at_one_is_kept_by_the_other(pair):
    first, second = pair
    second.admin.post("/v1/robots/robot-0/drain")
    until(lambda: first.admin.get("/v1/robots/robot-0").json()["state"] == "draining", PATIENCE_S, "robot-0 to drain")
    job_id = first.submit(first.policy(), trials=12).json()["job_id"]
    first.wait_for_end(job_id)
    report = first.admin.get(f"/v1/jobs/{job_id}/report").json()
    assert {row["robot"] for row in report["per_robot"]} == {"robot-1", "robot-2", "robot-3"}
    second.admin.post("/v1/robots/robot-0/resume")
    for each in pair:
        until(lambda farm=each: farm.robots_in("idle") == 4, PATIENCE_S, "robot-0 to be idle again")


def test_the_same_key_at_both_makes_one_job(pair):
    policy, key = pair[0].policy(), {"Idempotency-Key": "both"}
    sent = [each.submit(policy, headers=key) for each in pair]
    assert [answer.status_code for answer in sent] == [201, 200]
    assert len({answer.json()["job_id"] for answer in sent}) == 1
    pair[1].wait_for_end(sent[0].json()["job_id"])


def test_cancel_at_one_stops_what_the_other_leased(pair):
    first, second = pair
    job_id = first.submit(first.policy(), trials=1000).json()["job_id"]
    until(lambda: second.job(job_id)["trials_done"] > 4, PATIENCE_S, "some trials to be done")
    second.admin.post(f"/v1/jobs/{job_id}/cancel")
    assert first.wait_for_end(job_id)["state"] == "cancelled"


def test_who_signs_out_at_one_is_signed_out_at_the_other(pair):
    first, second = pair
    with httpx.Client(base_url=first.api, trust_env=False) as browser, httpx.Client(trust_env=False) as elsewhere:
        assert browser.post("/sign-in", data={"token": first.tokens["admin"]}).status_code == 303
        cookie = {"Cookie": f"{COOKIE}={browser.cookies[COOKIE]}", "Accept": "text/html"}

        def at_the_other():
            return elsewhere.get(f"{second.api}/jobs", headers=cookie).status_code

        assert at_the_other() == 200
        word = re.search(r'name="csrf" value="([0-9a-f]+)"', browser.get("/jobs", headers={"Accept": "text/html"}).text)
        assert browser.post("/sign-out", data={"csrf": word[1]}).status_code == 303
        until(lambda: at_the_other() == 303, PATIENCE_S, "the session to end at the other process")


def test_a_killed_process_loses_nothing_and_the_others_end_the_job(pair):
    first, second = pair
    job_id = second.submit(second.policy(), trials=60).json()["job_id"]
    until(lambda: first.job(job_id)["trials_done"] > 4, PATIENCE_S, "some trials to be done")
    second.process.kill()
    second.process.wait()
    for number in (2, 3):
        second.robots[f"robot-{number}"].kill()
    assert first.wait_for_end(job_id)["state"] == "succeeded"
    report = first.admin.get(f"/v1/jobs/{job_id}/report").json()
    assert len(report["per_trial"]) == 60
    assert report["attempts"] == 60 + report["platform_faults"]
    assert first.stop(signal.SIGTERM) == 0
