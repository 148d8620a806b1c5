"""Faults on a farm, and the checker checked: with a protection lifted it reports what then goes wrong, with all of them nothing.

One small farm of real processes; its services are started anew for each protection that is lifted.
"""

import asyncio
import random
import time

import pytest

from chaos import history
from chaos.campaigns import MATRIX, inject
from chaos.clients import Load, clients
from chaos.farm import HOST, Farm, FarmSettings
from chaos.faults.fault import Scene
from chaos.gathering import gather
from chaos.isolation import Isolation
from chaos.processes import process_group, until
from chaos.promises import check
from chaos.robot import expected_success
from chaos.services import WITHOUT

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lifted")
    with process_group() as processes:
        made = Farm(FarmSettings(robots=2, lease_s=2.0), folder / "disk", folder / "evidence", processes)
        made.start()
        yield made
        made.close()


def start_without(farm, protection):
    """The services anew, with the protection lifted."""
    farm.api.kill()
    farm.restart(farm.services[0], **({} if protection is None else {WITHOUT: protection}))
    farm.ready_robots()


def submit(farm, key):
    """One submission whose answer never came, sent again: gives the id that was acknowledged last."""
    body = {"policy": farm.policy, "task": "push", "trials": 1, "seed": 1}
    for _ in range(2):
        answer = farm.http.post("/v1/jobs", json=body, headers={"Idempotency-Key": key})
        assert answer.is_success, answer.text
        farm.history("acknowledged", job=answer.json()["job_id"], owner="operator", key=key, trials=1, status=answer.status_code)
    return answer.json()["job_id"]


def broken(farm, tmp_path):
    verdict = check(asyncio.run(gather(farm, tmp_path)), expected_success)
    return {name for name, found in verdict.broken.items() if found}, verdict


def over(farm, job_id):
    return lambda: (farm.ask("GET", f"/v1/jobs/{job_id}") or {}).get("state") == "succeeded"


def late_outcome(farm, key):
    """A robot brings its outcome after another has done the trial."""
    for name in farm.robots:
        farm.orders.give("late", name)
    job_id = submit(farm, key)
    late = f"{job_id}-000"

    def answered():
        lines = [line for line in history.read(farm.evidence) if line.more.get("trial") == late]
        was_late = {(line.who, line.more["fence"]) for line in lines if line.did == "late"}
        ended = {(line.who, line.more["fence"]) for line in lines if line.did in ("answered", "gave-up")}
        return was_late and was_late <= ended

    until(answered, 120, "answers to all outcomes that came late")
    for name in farm.robots:
        farm.orders.take("late", name)
    until(over(farm, job_id), 120, "the end of the job")


QUICK_FAULTS = (
    "kill-robot",
    "kill-api",
    "die-before-answer",
    "late-outcome",
    "repeated-outcome",
    "cut-answers",
    "cut-without-key",
)


def test_with_all_protections_nothing_is_reported_whatever_is_done(farm, tmp_path):
    load = Load(clients=3, jobs=10**6, pace_s=0.5, seed=3)
    with clients(load, farm.tokens, farm.policy, farm.evidence, HOST, farm.port) as at_work:
        scene = Scene(farm, at_work, random.Random(3), Isolation("not in this test"), quick=True)
        injections = [inject(fault, scene) for fault in MATRIX if fault.name in QUICK_FAULTS]
        at_work.submit_no_more()
        until(at_work.all_over, 120, "the end of all jobs")
    assert [each.seen for each in injections if not each.verified] == []
    assert len(injections) == len(QUICK_FAULTS)
    found, verdict = broken(farm, tmp_path)
    assert found == set(), verdict.broken
    assert verdict.stale_refused >= 1
    assert verdict.acknowledged > 10


def test_without_the_fence_trials_have_two_outcomes(farm, tmp_path):
    start_without(farm, "fence")
    late_outcome(farm, "fence")
    found, verdict = broken(farm, tmp_path)
    assert "duplicated" in found
    assert any("more than one outcome that counts" in each for each in verdict.broken["duplicated"])


def test_without_the_key_a_submission_is_not_found_again(farm, tmp_path):
    start_without(farm, "key")
    before = broken(farm, tmp_path)[1]
    assert before.broken["lost"] == ()
    until(over(farm, submit(farm, "key")), 120, "the end of the job")
    found, verdict = broken(farm, tmp_path)
    assert "lost" in found
    assert all("nothing is found under this key" in each for each in verdict.broken["lost"])
    assert any("key key made the jobs" in each for each in verdict.broken["duplicated"])


def test_without_the_end_of_leases_a_trial_is_stuck(farm, tmp_path):
    start_without(farm, "expiry")
    assert broken(farm, tmp_path)[1].broken["stuck"] == ()
    for name in farm.robots:
        farm.orders.give("late", name)
    job_id = submit(farm, "expiry")
    until(
        lambda: any(line.did == "late" and line.more["trial"].startswith(job_id) for line in history.read(farm.evidence)),
        120,
        "it to run",
    )
    for name in farm.robots:
        farm.processes[name].kill()
    time.sleep(farm.settings.lease_s + 3.0)
    found, verdict = broken(farm, tmp_path)
    assert "stuck" in found
    assert all("its lease ended" in each for each in verdict.broken["stuck"])
