"""How quickly every page answers with 10,000 jobs in the database while four robots work: ``python -m`` it from the root."""

import argparse
import hashlib
import json
import os
import sqlite3
import tempfile
import time
from pathlib import Path

import httpx
import numpy as np

from tests.integration.farm_process import Services, until

TRIALS = 40
POLICIES, RUNGS = 500, 50
PAGES = (
    "/",
    "/jobs",
    "/jobs?q=push",
    "/jobs?state=queued",
    "/jobs?q=nothing-like-this",
    "/compare",
    "/jobs/{done}",
    "/compare?jobs={two}",
    "/ladders",
    "/ladders/l0",
    "/leaderboard",
    "/studies",
)
OUTCOME = {"kind": "succeeded", "fault": "none", "reason": "reached", "measures": None}


def fill(path: Path, policy: str, report: bytes, count: int) -> None:
    """Puts so many jobs with all their trials and attempts into a stopped farm's database; a tenth of them is queued."""
    queued, ladder_count = count // 10, count // (2 * RUNGS)
    now_s, at = time.time(), "2026-01-01T00:00:00.000Z"
    jobs, trials, attempts, events, reports = [], [], [], [], []
    for number in range(100, 100 + count):
        is_done, name = number < 100 + count - queued, f"b{number}"
        state, done = ("succeeded", TRIALS) if is_done else ("queued", 0)
        ended_at = at if is_done else None
        its_policy = hashlib.sha256(b"%d" % (number % POLICIES)).hexdigest() if is_done else policy
        jobs.append((number, name, state, its_policy, "small", f"user{number % 20}", TRIALS, done, done, ended_at, now_s))
        for ordinal in range(TRIALS):
            trial = f"{name}-{ordinal:03d}"
            robot = f"robot-{ordinal % 4}" if is_done else None
            ended = ("done", json.dumps(OUTCOME | {"wall_s": 1.0})) if is_done else ("queued", None)
            trials.append((trial, number, ordinal, ended[0], ordinal, robot, int(is_done), ended[1]))
            if is_done:
                attempts.append((trial, number, robot, at, at, ended[1]))
                events.append((number, ordinal + 1, at, ordinal, ordinal + 1, ordinal + 1))
        if is_done and number % 100 < 2:
            body = report.replace(b"JOB_ID", name.encode())
            reports.append((number, body, hashlib.sha256(body).hexdigest(), at))
    with sqlite3.connect(path) as database:
        database.executemany(
            "insert into job (number, job_id, state, policy, policy_name, owner, trials, trials_done, successes, ended_at, "
            "created_s, task, object, object_scale, seed, seed_drawn_by_server, created_at, cancel_requested, trials_active, "
            "policy_faults, platform_faults, last_event) "
            "values (?,?,?,?,?,?,?,?,?,?,?, 'push','cube',1.0,1,1,'2026-01-01T00:00:00.000Z',0,0,0,0,40)",
            jobs,
        )
        database.executemany(
            "insert into trial (trial_id, job_number, ordinal, state, seed, robot, fence, outcome, robot_order, faults) "
            "values (?,?,?,?,?,?,?,?,'[]',0)",
            trials,
        )
        database.executemany(
            "insert into attempt (trial_id, job_number, robot, started_at, ended_at, outcome, fence, state) "
            "values (?,?,?,?,?,?,1,'accepted')",
            attempts,
        )
        database.executemany(
            "insert into event (job_number, id, at, trial_ordinal, trials_done, successes, kind, text, state) "
            "values (?,?,?,?,?,?,'trial_done','','running')",
            events,
        )
        # on the physics of the robots that will be there: the leaderboard that is shown first has all policies
        (physics,) = database.execute("select max(number) from physics").fetchone()
        database.execute("update job set physics = ? where job_id like 'b%'", (physics,))
        ladders = [(number, f"l{number}", f"ladder {number}", "user1", at) for number in range(ladder_count)]
        database.executemany("insert into ladder (number, ladder_id, name, owner, created_at) values (?,?,?,?,?)", ladders)
        rungs = [
            (number, place, 1e4 * place, 100 + RUNGS * number + place) for number in range(ladder_count) for place in range(RUNGS)
        ]
        database.executemany("insert into rung (ladder_number, ordinal, step, job_number) values (?,?,?,?)", rungs)
        database.executemany("insert into report (job_number, body, sha256, created_at) values (?,?,?,?)", reports)


def measure(farm: Services, seconds: float) -> dict[str, dict[str, float]]:
    """Milliseconds of each page, by operator."""
    with httpx.Client(base_url=farm.api, follow_redirects=True, timeout=60) as client:
        client.post("/sign-in", data={"token": farm.tokens["admin"]})
        times_ms: dict[str, list[float]] = {page: [] for page in PAGES}
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            for page in PAGES:
                began_s = time.perf_counter()
                answer = client.get(page.format(done="b100", two="b100,b101"))
                times_ms[page].append(1e3 * (time.perf_counter() - began_s))
                assert answer.status_code == 200, (page, answer.text[:300])
    return {page: _shown(each) for page, each in times_ms.items()}


def _shown(times_ms: list[float]) -> dict[str, float]:
    median, p95 = (round(float(np.percentile(times_ms, share)), 1) for share in (50, 95))
    return {"median_ms": median, "p95_ms": p95, "times": len(times_ms)}


def main() -> None:
    """Fills a farm, starts it with scripted robots, and prints what was measured."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=40)
    parser.add_argument("--jobs", type=int, default=10_000, help="in the database; at least 100")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="trifarm-pages-") as folder:
        farm = Services(Path(folder) / "farm", requests_per_s="0")
        try:
            farm.start()
            policy = farm.policy()
            farm.start_robots(4, trial_s=0.02)
            one = farm.submit(policy, trials=TRIALS).json()["job_id"]
            farm.wait_for_end(one)
            report = farm.admin.get(f"/v1/jobs/{one}/report").content.replace(one.encode(), b"JOB_ID")
            for robot in farm.robots.values():
                robot.terminate()
                robot.wait(10)
            farm.stop()
            fill(Path(folder) / "farm" / "farm.sqlite", policy, report, given.jobs)
            farm.start()
            for number in range(4):
                farm.start_robot(f"robot-{number}", trial_s=2.0)
            until(lambda: farm.robots_in("idle", "leased", "running") == 4, 30, "4 robots at work")
            found = {"jobs": given.jobs, "trials": given.jobs * TRIALS, "queued_jobs": given.jobs // 10, "cores": os.cpu_count()}
            found |= {"load_before": os.getloadavg()[0], "pages": measure(farm, given.seconds)}
        finally:
            farm.close()
    text = json.dumps(found, indent=2)
    print(text)
    if given.out:
        given.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
