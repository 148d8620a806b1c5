"""A job of 100,000 trials: its submission, its trials, its pages and its end, on SQLite and on PostgreSQL.

    python -m tests.benchmarks.large_job --out results/large-job.json

At 60 outcomes a second such a job takes half an hour. So no robot works here: the job is submitted to services that run, which
make as many trials as robots need ahead, while the status and the job's page are asked for. Then the services stop; all trials
are made by the code that makes them page by page, and their outcomes and attempts are written into the database directly, of
robots that do not exist and without the lines of the job's history. The end is measured twice, in this process, where each
transaction is timed, and by services that are started again, while the status is asked for. A writer's time is from the moment
at which it may write to its commit.
"""

import argparse
import asyncio
import json
import os
import tempfile
import time
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path

from sqlalchemy import delete, literal, text, update

from api_schemas.trial import Outcome
from services.database.database import Database, address
from services.database.tables import event, job, report
from services.dispatcher.large_jobs import LargeJobs
from services.jobs import filling
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from services.settings import TRIALS_PAGE
from tests.benchmarks.asking import Asking, client_of, spread_ms
from tests.benchmarks.machine import kind
from tests.homes import now, postgres_server
from tests.integration.farm_process import Services, until

NO_LIMITS = {"requests_per_s": 0, "anonymous_requests_per_s": 0, "robot_requests_per_s": 0}
TOKENS = {"admin_token": "trifarm_large-admin_" + "a" * 40, "robot_token": "trifarm_large-robot_" + "r" * 40}
ROBOTS, SUBMISSIONS, ASK_EVERY_S, STATUS = 100, 5, 0.05, "/v1/status"
MEASURES = {"success_at_end": True, "success_ever": True, "success_fraction": 0.5, "final_position_error_m": 0.004}
MEASURES |= {"final_angle_error_rad": None, "episode_return": -3.25, "control_steps": 500, "simulated_s": 10.0}
TIMING = {"mean_ms": 0.4, "p99_ms": 0.9, "max_ms": 1.8, "allowed_ms": 11.0, "missed": 0}
DONE = (
    "UPDATE trial SET state = 'done', fence = 1, log_bytes = 1000, log_sha256 = :log, robot = 'robot-' || (ordinal % :robots), "
    "first_choice = 'robot-' || (ordinal % :robots), outcome = CASE WHEN ordinal % 3 = 0 THEN :failed ELSE :reached END"
)
TRIED = (
    "INSERT INTO attempt (trial_id, fence, job_number, robot, state, reason, started_at, ended_at, outcome, log_sha256) "
    "SELECT trial_id, 1, job_number, robot, 'accepted', 'said', '2026-11-25T20:00:00.000Z', '2026-11-25T20:00:10.000Z', "
    "outcome, log_sha256 FROM trial WHERE job_number = :number"
)


def figures(asking, *names):
    """What somebody who asked found, of the status and of pages by these names."""
    return {name: spread_ms(took_s) for name, took_s in zip(("status", *names), asking.took_s.values(), strict=True)}


class Timed(Database):
    """A database that notes how long each transaction could write."""

    held_s: tuple[float, ...] = ()

    @asynccontextmanager
    async def write(self, *, lasting=True):
        began_s = 0.0
        async with super().write(lasting=lasting) as tx:
            began_s = time.monotonic()
            yield tx
        self.held_s = (*self.held_s, time.monotonic() - began_s)


async def filled(url, trials):
    """Makes all trials of the job as fast as pages can be written, and ends them; gives what the pages took."""
    database = Timed(address(url))
    try:
        began_s = time.monotonic()
        while True:
            async with database.read() as connection:
                (row,) = [
                    each for each in await filling.unfinished(connection) if each.trials == trials and not each.cancel_requested
                ]
            if row.trials_made >= row.trials:
                break
            async with database.write(lasting=False) as tx:
                await filling.fill(tx, row, TRIALS_PAGE)
        took_s, held_s = time.monotonic() - began_s, database.held_s
        told = [outcome_of(succeeded).model_dump_json() for succeeded in (True, False)]
        async with database.write() as tx:
            given = {"reached": told[0], "failed": told[1], "robots": ROBOTS, "log": "f" * 64}
            await tx.execute(text(f"{DONE} WHERE job_number = :number"), given | {"number": row.number})
            await tx.execute(text(TRIED), {"number": row.number})
            successes = sum(at % 3 != 0 for at in range(trials))
            counts = {"trials_done": trials, "successes": successes, "state": "running"}
            await tx.execute(
                update(job).where(job.c.number == row.number).values(**counts, started_at="2026-11-25T20:00:00.000Z")
            )
        return row.number, {"pages": len(held_s), "seconds": round(took_s, 1), "writer": spread_ms(held_s)}
    finally:
        await database.close()


def outcome_of(succeeded):
    kept = {"kind": "succeeded" if succeeded else "failed", "fault": "none", "reason": "1 of 1 s within 20 mm of the goal"}
    kept |= {"measures": MEASURES | {"success_at_end": succeeded}, "policy_timing": TIMING, "wall_s": 10.5, "form": "first"}
    if not succeeded:
        kept["failure"] = {"kind": "late", "sentence": "the cube was on its way when the time was over", "at_s": 9.0}
    return Outcome.model_validate(kept)


async def ended_here(url, number):
    """Ends the job in this process; then takes the end back. Gives seconds and what each transaction took."""
    database = Timed(address(url))
    try:
        began_s = time.monotonic()
        await LargeJobs(database, FarmClock.start(), Signals(), TRIALS_PAGE).look()
        found = {"seconds": round(time.monotonic() - began_s, 1), "writer": spread_ms(database.held_s)}
        async with database.write() as tx:
            kept = (await tx.execute(report.select().where(report.c.job_number == number))).one()
            found["report_mb"] = round(len(kept.body) / 1e6, 2)
            await tx.execute(delete(report).where(report.c.job_number == number))
            await tx.execute(delete(event).where(event.c.job_number == number, event.c.kind == "job_ended"))
            back = {"state": literal("running"), "outcomes": None, "ended_at": None}
            await tx.execute(update(job).where(job.c.number == number).values(**back))
        return found
    finally:
        await database.close()


def pages(farm, job_id, trials):
    """What is asked for when all trials are there."""
    last = f"/jobs/{job_id}?order=trial&first={max(0, trials - 100)}"
    wanted = {"job_page": f"/jobs/{job_id}", "job_page_last_trials": last, "glimpses": f"/jobs/{job_id}/glimpses"}
    wanted |= {"job": f"/v1/jobs/{job_id}", "first_trials": f"/v1/jobs/{job_id}/trials?limit=200"}
    wanted |= {
        "report": f"/v1/jobs/{job_id}/report",
        "report_page": f"/jobs/{job_id}/report",
        "farm_page": "/",
        "jobs_page": "/jobs",
    }
    found = {}
    with client_of(farm) as client:
        for name, path in wanted.items():
            took_s = []
            for _ in range(5):
                began_s = time.monotonic()
                answer = client.get(path)
                took_s.append(time.monotonic() - began_s)
                assert answer.status_code == 200, (path, answer.text[:300])
            found[name] = spread_ms(took_s)
        with Asking(farm, STATUS, every_s=ASK_EVERY_S) as asking:
            began_s = time.monotonic()
            table = client.get(f"/v1/jobs/{job_id}/trials.csv").text
        assert table.count("\n") == trials + 1
        found["table"] = {"seconds": round(time.monotonic() - began_s, 1), "mb": round(len(table) / 1e6, 1), **figures(asking)}
    return found


def measured(home, trials, watch_s, postgres):
    """One home."""
    found = {"home": home, "trials": trials, "load_before": round(os.getloadavg()[0], 1)}
    with tempfile.TemporaryDirectory(prefix="trifarm-large-") as folder:
        url = now(postgres.empty()) if home == "scale" else f"sqlite:///{folder}/farm/farm.sqlite"
        more = {"database_url": url} if home == "scale" else {}
        farm = Services(Path(folder) / "farm", **NO_LIMITS, **TOKENS, **more)  # names of settings
        try:
            farm.start()
            policy, job_id, took_s, cancelled_s = farm.policy(), "", [], []
            for seed in range(SUBMISSIONS):
                began_s = time.monotonic()
                answer = farm.submit(policy, trials=trials, seed=seed)
                took_s.append(time.monotonic() - began_s)
                assert answer.status_code == 201, answer.text
                job_id = answer.json()["job_id"]
                if seed < SUBMISSIONS - 1:
                    time.sleep(1.5)  # the trials ahead are there
                    began_s = time.monotonic()
                    farm.admin.post(f"/v1/jobs/{job_id}/cancel").raise_for_status()
                    cancelled_s.append(time.monotonic() - began_s)
            with Asking(farm, STATUS, f"/jobs/{job_id}", every_s=ASK_EVERY_S) as asking:
                until(lambda: len(asking.took_s[STATUS]) > 0, 60, "the first answer")
                time.sleep(watch_s)
            found |= {"submit": spread_ms(took_s), "cancel": spread_ms(cancelled_s), "after_submit": figures(asking, "job_page")}
            farm.stop()
            number, found["filling"] = asyncio.run(filled(url, trials))
            found["end"] = asyncio.run(ended_here(url, number))
            farm.start()
            with Asking(farm, STATUS, f"/jobs/{job_id}", every_s=ASK_EVERY_S) as asking:
                began_s = time.monotonic()
                until(lambda: farm.job(job_id)["state"] == "succeeded", 600, "the end of the job")
                found["end_by_services"] = {"seconds": round(time.monotonic() - began_s, 1)}
            found["end_by_services"] |= figures(asking, "job_page")
            found["pages"] = pages(farm, job_id, trials)
        finally:
            farm.close()
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=100_000)
    parser.add_argument("--watch-s", type=float, default=10.0, help="how long the status and the page are asked for at first")
    parser.add_argument("--homes", choices=("embedded", "scale"), nargs="+", default=["embedded", "scale"])
    asked = parser.parse_args()
    with postgres_server() if "scale" in asked.homes else nullcontext() as postgres:
        for home in asked.homes:
            run = measured(home, asked.trials, asked.watch_s, postgres)
            print(json.dumps(run), flush=True)
            kept = json.loads(asked.out.read_text()) if asked.out.exists() else {"machine": kind(), "runs": []}
            kept["runs"].append(run)
            asked.out.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
