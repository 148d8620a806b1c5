"""10,000 queued jobs of 20 users, one of whom floods the farm: how long a small user waits, and whether memory grows.

A real services process with scripted robots, on SQLite and then on PostgreSQL and S3. The flooding user has every second job.
Again and again a new user submits a job of a few trials. His fair time is what his trials take when every user who waits gets
the same share of the pace that the farm had just then; what counts is how many times longer he waited, at most.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from tests.homes import postgres_server, s3_server, scale_settings
from tests.integration.farm_process import services, until

USERS, ROBOTS, TRIAL_S, SUBMITTING = 20, 4, 0.05, 8
SMALL_TRIALS, WAITS_AT_MOST, GROWS_AT_MOST = 20, 2.0, 1.05
SETTINGS = {"max_queued_jobs_per_user": 1_000_000, "requests_per_s": 0, "anonymous_requests_per_s": 0, "robot_requests_per_s": 0}


def leases(farm):
    """Trials that were begun so far."""
    for family in text_string_to_metric_families(farm.admin.get("/metrics").text):
        for sample in family.samples:
            if sample.name == "trifarm_leases_total":
                return sample.value
    raise AssertionError("no count of leases")


def memory_mb(farm):
    """Of the services process, resident."""
    pages = int(Path(f"/proc/{farm.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def new_user(farm, name):
    """His client, and the policy that he uploaded."""
    secret = farm.admin.post("/v1/tokens", json={"owner": name, "scopes": ["submit"]}).json()["secret"]
    client = farm.client(secret)
    return client, farm.policy(client)


def fill(farm, jobs, trials):
    """Jobs of all users, every second of the first."""
    users = [new_user(farm, f"user-{number:02d}") for number in range(USERS)]

    def submit(number):
        user, policy = users[0 if number % 2 else number // 2 % USERS]
        answer = farm.submit(policy, client=user, trials=trials, seed=number)
        assert answer.status_code == 201, answer.text

    began_s = time.monotonic()
    with ThreadPoolExecutor(SUBMITTING) as pool:
        list(pool.map(submit, range(jobs)))
    return round(time.monotonic() - began_s, 1)


def small_user_waits(farm, number):
    """How many times longer than fair a new user waits for his trials, and the pace meanwhile in trials per second."""
    user, policy = new_user(farm, f"small-{number}")
    began_s, before = time.monotonic(), leases(farm)
    job_id = farm.submit(policy, client=user, trials=SMALL_TRIALS, seed=number).json()["job_id"]
    while user.get(f"/v1/jobs/{job_id}").json()["state"] not in ("succeeded", "failed", "cancelled"):
        time.sleep(0.1)
    waited_s = time.monotonic() - began_s
    pace = (leases(farm) - before) / waited_s
    return waited_s * pace / (SMALL_TRIALS * (USERS + 1)), pace


def crowded(folder, jobs, trials, minutes, **home):
    """What one farm did."""
    with services(folder / "farm", **SETTINGS, **home) as farm:
        filled_s = fill(farm, jobs, trials)
        for number in range(ROBOTS):
            farm.start_robot(f"robot-{number}", trial_s=TRIAL_S)
        until(lambda: farm.robots_in("idle", "running") == ROBOTS, 60, f"{ROBOTS} robots")
        waits, paces, memory, ends_s = [], [], [], time.monotonic() + 60 * minutes
        while time.monotonic() < ends_s:
            times, pace = small_user_waits(farm, len(waits))
            waits.append(times)
            paces.append(pace)
            memory.append(memory_mb(farm))
        third = max(1, len(memory) // 3)
        early, late = statistics.median(memory[:third]), statistics.median(memory[-third:])
        return {
            "submitting_s": filled_s,
            "small_users": len(waits),
            "times_fair_most": round(max(waits), 2),
            "times_fair_median": round(statistics.median(waits), 2),
            "trials_per_s_median": round(statistics.median(paces), 1),
            "memory_mb_early": round(early, 1),
            "memory_mb_late": round(late, 1),
            "memory_ratio": round(late / early, 3),
        }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--trials", type=int, default=40, help="of a job")
    parser.add_argument("--minutes", type=float, default=3.0, help="on each home")
    given = parser.parse_args()
    found: dict[str, Any] = {
        "jobs": given.jobs,
        "trials": given.jobs * given.trials,
        "users": USERS,
        "robots": ROBOTS,
        "trial_s": TRIAL_S,
    }
    found |= {"small_user_trials": SMALL_TRIALS, "load_before": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as name, postgres_server() as postgres, s3_server() as s3:
        postgres.make_newest()
        for home, settings in (("embedded", {}), ("scale", scale_settings(postgres, s3))):
            folder = Path(name) / home
            folder.mkdir()
            found[home] = crowded(folder, given.jobs, given.trials, given.minutes, **settings)
            print(json.dumps({home: found[home]}), flush=True)
    if given.out:
        given.out.write_text(json.dumps(found, indent=1) + "\n")
    kept = [
        each["times_fair_most"] <= WAITS_AT_MOST and each["memory_ratio"] <= GROWS_AT_MOST
        for each in (found["embedded"], found["scale"])
    ]
    return int(not all(kept))


if __name__ == "__main__":
    raise SystemExit(main())
