"""A farm of another commit is updated to this one while 200 trials wait and some run: is anything lost, or done twice?

    python -m tests.benchmarks.update_farm CHECKOUT --python CHECKOUT/.venv/bin/python --out results/update-farm.json

As docs/running-a-farm.md says, on each home (SQLite and a folder; PostgreSQL and S3): the old services end while trials run, this
commit's start on what they left, and then scripted robots of the old commit are replaced by this one's, one after the other. What
must hold: all trials are done, each by one accepted attempt; what had been done before stays byte for byte; every log can be
fetched and is what its trial names; every job has its report; no attempt failed by the platform's fault.
"""

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.benchmarks.machine import kind
from tests.homes import now, postgres_server, s3_server
from tests.integration.farm_process import ROOT, Services, until

ROBOTS, JOBS, TRIALS, TRIAL_S = 4, 5, 40, 0.2
BEFORE_AT_LEAST = 20
"""Trials that are done before the update."""
TOKENS = {"admin_token": "trifarm_update-admin_" + "a" * 40, "robot_token": "trifarm_update-robot_" + "r" * 40}
DONE_WITHIN_S = 600.0


@contextmanager
def running(command, checkout, farm, said):
    """A process of a checkout; told to stop at the end if it still runs."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
    environment |= farm.settings
    with said.open("ab") as words:
        process = subprocess.Popen(command, cwd=checkout, env=environment, stdout=words, stderr=words)
    try:
        yield process
    finally:
        if process.poll() is None:
            stop(process)


def stop(process):
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) is not None


def services_of(python, checkout, farm, folder):
    where = ["--data", str(farm.data), "--host", farm.host, "--port", str(farm.port), "--bus", farm.bus]
    return running([str(python), "-m", "services", "serve", *where], checkout, farm, folder / "services.log")


def robot_of(python, checkout, farm, number, folder):
    told = [f"robot-{number}", "--api", farm.api, "--bus", farm.bus, "--trial-s", str(TRIAL_S)]
    return running([str(python), "-m", "tests.integration.scripted_robot", *told], checkout, farm, folder / f"robot-{number}.log")


def trials_of(farm, jobs):
    """All trials of the jobs, by id."""
    return {each["trial_id"]: each for job in jobs for each in farm.admin.get(f"/v1/jobs/{job}/trials").json()["trials"]}


def done(trials):
    return {name: trial for name, trial in trials.items() if trial["state"] == "done"}


def updated(old_python, old_checkout, folder, **home):
    """One farm before, during and after its update; gives what was found."""
    farm = Services(folder / "farm", **TOKENS, **home)
    farm.admin = farm.client(TOKENS["admin_token"])
    with ExitStack() as stack:
        with services_of(old_python, old_checkout, farm, folder) as farm.process:
            until(farm._healthy, 90, "the services of the old commit")
            robots = [stack.enter_context(robot_of(old_python, old_checkout, farm, n, folder)) for n in range(ROBOTS)]
            until(lambda: farm.robots_in("idle") == ROBOTS, 60, "robots of the old commit")
            policy = farm.policy()
            jobs = [farm.submit(policy, trials=TRIALS, seed=seed).json()["job_id"] for seed in range(JOBS)]
            until(lambda: len(done(trials_of(farm, jobs))) >= BEFORE_AT_LEAST, DONE_WITHIN_S, "some trials")
            before = trials_of(farm, jobs)
        away_s = time.monotonic()
        farm.process = stack.enter_context(services_of(sys.executable, ROOT, farm, folder))
        until(farm._healthy, 90, "the services of this commit")
        away_s = time.monotonic() - away_s
        at_update = trials_of(farm, jobs)
        for number, robot in enumerate(robots):
            replace(stack, farm, number, robot, folder)
        for job in jobs:
            until(lambda job=job: farm.job(job)["state"] in ("succeeded", "failed"), DONE_WITHIN_S, f"the end of {job}")
        found = judged(farm, jobs, before)
    doctor = [sys.executable, "-m", "client_cli", "doctor", "--data", str(farm.data), "--deep"]
    if not home:
        found["doctor_exit"] = subprocess.run(doctor, cwd=ROOT, capture_output=True, check=False).returncode
    counts = {state: sum(each["state"] == state for each in before.values()) for state in ("queued", "leased", "running", "done")}
    return {"before": counts, "done_at_the_new_start": len(done(at_update)), "services_away_s": round(away_s, 1)} | found


def replace(stack, farm, number, old, folder):
    """A robot of the old commit finishes its trial and ends; one of this commit has its name from then on."""
    farm.admin.post(f"/v1/robots/robot-{number}/drain").raise_for_status()
    until(lambda: shown(farm, number)["trial"] is None and shown(farm, number)["state"] == "draining", 60, "a drained robot")
    stop(old)
    stack.enter_context(robot_of(sys.executable, ROOT, farm, number, folder))
    farm.admin.post(f"/v1/robots/robot-{number}/resume").raise_for_status()


def shown(farm, number):
    return farm.admin.get(f"/v1/robots/robot-{number}").json()


def judged(farm, jobs, before):
    """What must hold, counted."""
    trials, reports = trials_of(farm, jobs), [farm.admin.get(f"/v1/jobs/{job}/report") for job in jobs]
    attempts = [each for trial in trials.values() for each in trial["attempts"]]
    accepted = [sum(each["state"] == "accepted" for each in trial["attempts"]) for trial in trials.values()]
    changed = [name for name, trial in done(before).items() if not is_kept(trial, trials[name])]
    logs = {name: farm.admin.get(f"/v1/trials/{name}/log").content for name in trials}
    return {
        "trials": len(trials),
        "done": len(done(trials)),
        "done_twice": sum(count > 1 for count in accepted),
        "without_accepted_attempt": sum(count == 0 for count in accepted),
        "changed_of_those_done_before": len(changed),
        "logs_wrong_or_gone": sum(hashlib.sha256(log).hexdigest() != trials[n]["log_sha256"] for n, log in logs.items()),
        "reports": sum(report.status_code == 200 and report.json()["trials"] == TRIALS for report in reports),
        "platform_faults": sum(each["state"] == "platform_fault" for each in attempts),
        "reasons": sorted({each["reason"] for each in attempts if each["state"] == "platform_fault"}),
        "jobs": sorted(farm.job(job)["state"] for job in jobs),
        "robots_of_attempts": len({each["robot"] for each in attempts}),
    }


def is_kept(before, after):
    """Whether nothing is another than before; a field that came with the update and says nothing is no change."""
    if isinstance(before, dict):
        return all(
            is_kept(before[key], after[key]) if key in before else after[key] is None for key in before.keys() | after.keys()
        )
    if isinstance(before, list):
        return len(before) == len(after) and all(map(is_kept, before, after))
    return before == after


def holds(found):
    wrong = ("done_twice", "without_accepted_attempt", "changed_of_those_done_before", "logs_wrong_or_gone", "platform_faults")
    whole = found["done"] == found["trials"] == JOBS * TRIALS and found["reports"] == JOBS
    return whole and not any(found[name] for name in wrong) and not found.get("doctor_exit")


def main():
    """Updates a farm on each home."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="of the old commit")
    parser.add_argument("--python", type=Path, required=True, help="of an environment that has the old commit")
    parser.add_argument("--homes", nargs="+", choices=["embedded", "scale"], default=["embedded", "scale"])
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=asked.checkout, capture_output=True, text=True, check=True)
    found: dict[str, Any] = {"from": commit.stdout.strip(), "robots": ROBOTS, "trial_s": TRIAL_S, "machine": kind()}
    for home in asked.homes:
        with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
            settings = {}
            if home == "scale":
                postgres, s3 = stack.enter_context(postgres_server()), stack.enter_context(s3_server())
                settings = {"database_url": now(postgres.empty())} | s3.settings()
            found[home] = updated(asked.python.absolute(), asked.checkout.absolute(), Path(name), **settings)
            found[home] |= {"holds": holds(found[home]), "load": round(os.getloadavg()[0], 1)}
            print(json.dumps({home: found[home]}), flush=True)
            asked.out.write_text(json.dumps(found, indent=1) + "\n")
    return int(not all(found[home]["holds"] for home in asked.homes))


if __name__ == "__main__":
    sys.exit(main())
