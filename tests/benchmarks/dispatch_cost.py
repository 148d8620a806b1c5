"""What the dispatcher and a robot's arrival cost a processor by the number of robots, without bus, API and other processes.

    python tests/benchmarks/dispatch_cost.py --robots 10 100 1000

Looks of the dispatcher on SQLite, all robots idle: with nothing queued, with three trials, and with five for each robot,
of which it gives as many as it can within two seconds; the arrival of all robots, ten at a time; and a page of a long job's
trials. Times are the processor's, of this process, so that other load of the machine enters only through its caches. With
PYTHONPATH at another checkout, and this file called by its path, that is measured.
"""

import argparse
import asyncio
import json
import tempfile
import time
from pathlib import Path

from prometheus_client import CollectorRegistry
from sqlalchemy import delete, insert

import services
from api_schemas.bus import Heartbeat
from api_schemas.policy import LAYOUTS
from api_schemas.robot import OfferReply, RobotState
from api_schemas.trial import TrialState
from services.database.database import Database, migrate
from services.database.pages import Asked
from services.database.tables import job, policy, trial
from services.disk import Disk
from services.dispatcher.dispatcher import Dispatcher, Metrics
from services.jobs import lists, views
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals
from services.settings import Settings

D = "d" * 64
POLICY = {"number": 1, "digest": D, "name": "p", "weights_format": "onnx", "weights_sha256": D, "weights_bytes": 1}
POLICY |= {"graph_sha256": D, "manifest": LAYOUTS["rrc2022-push"].model_dump_json(), "warnings": "[]", "owner": "o"}
JOB = {"job_id": "j1", "state": "queued", "policy": D, "policy_name": "p", "task": "push", "seed_drawn_by_server": False}
JOB |= {"number": 1, "owner": "o", "seed": 1, "created_at": "now", "created_s": 0.0}
GIVING_S, PAGED_TRIALS, TABLES = 2.0, 10_000, job.metadata.tables


def beat(number):
    return Heartbeat(robot=f"robot-{number:04d}", instance="one", pid=1, host="h", state=RobotState.IDLE)


class Yes:
    """A bus on which every robot takes what it is offered."""

    async def offer(self, _lease, _timeout_s):
        return OfferReply(accepted=True)


async def costs(robots, folder):
    """Milliseconds of the processor."""
    url = f"sqlite+aiosqlite:///{folder}/farm.sqlite"
    await migrate(url)
    database, clock, fleet = Database(url), FarmClock.start(), Fleet()
    settings = Settings(data=folder, max_attempts=5)
    dispatcher = Dispatcher(
        settings,
        database,
        Yes(),  # pyrefly: ignore[bad-argument-type] - all of a bus that it needs
        clock,
        fleet,
        Signals(),
        Metrics.register(CollectorRegistry()),
        Disk(folder, reserve_bytes=0),
    )
    async with database.write() as tx:
        await tx.execute(insert(policy).values(POLICY | {"created_at": "now"}))
    found = {"robots": robots, "arrival_ms_each": await arrivals(dispatcher, fleet, clock, robots)}
    for member in fleet.members.values():
        member.seen_s = clock.now_s() + 1e6  # they go on to be heard
    await look(dispatcher)
    found["look_ms"] = await look(dispatcher)
    for _ in range(2):  # statements are compiled once
        await fill(database, fleet, 3)
        found["look_that_gives_three_ms"] = await look(dispatcher)
    await fill(database, fleet, 5 * robots)
    found |= await giving(dispatcher, fleet)
    await fill(database, fleet, PAGED_TRIALS)
    found["page_of_trials_ms"] = await page(database, fleet, clock)
    await database.close()
    return found


async def arrivals(dispatcher, fleet, clock, robots):
    began_s = time.process_time()
    for first in range(0, robots, 10):
        for number in range(first, min(first + 10, robots)):
            fleet.token_changed(beat(number).robot, present=True, now_s=clock.now_s())
            dispatcher._hearing._heard(beat(number))
        await settled(dispatcher)
    return round(1e3 * (time.process_time() - began_s) / robots, 2)


async def settled(dispatcher):
    while dispatcher._steps._running:
        await asyncio.wait(list(dispatcher._steps._running))


async def look(dispatcher):
    began_s = time.process_time()
    await dispatcher._look(look_at_active=True, leads=True)
    await settled(dispatcher)
    return round(1e3 * (time.process_time() - began_s), 1)


async def page(database, fleet, clock):
    """The last 200 of a job's 10,000 trials, as GET /v1/jobs/{job_id}/trials shows them."""
    began_s = time.process_time()
    async with database.read() as connection:
        row = await views.job_row(connection, "j1", None)
        trials = await lists.trial_page(connection, row.number, Asked(200, PAGED_TRIALS - 201))
        assert len(await views.show_trials(connection, row, trials.entries, fleet, clock.now_s())) == 200
    return round(1e3 * (time.process_time() - began_s), 1)


async def fill(database, fleet, trials):
    """A job of so many trials, none of them drawn, for robots that are idle again; what was there is gone."""
    row = {"job_number": 1, "owner": "o", "state": TrialState.HELD, "fence": 0, "faults": 0, "robot_order": "[]"}
    state = {"state": TrialState.QUEUED}
    rows = [row | state | {"trial_id": f"j1-{each:05d}", "ordinal": each, "seed": each} for each in range(trials)]
    async with database.write() as tx:
        for table in ("event", "attempt", "trial", "job"):
            await tx.execute(delete(TABLES[table]))
        await tx.execute(insert(job).values(JOB | {"trials": trials}))
        await tx.execute(insert(trial), rows)
    fleet.hold_only(())
    for member in fleet.members.values():
        member.ended, member.paused_until_s = None, 0.0


async def giving(dispatcher, fleet):
    """Passes until two seconds of the processor are over or every robot has a trial."""
    began_s, passes = time.process_time(), 0
    leased = lambda: sum(member.lease is not None for member in fleet.members.values())  # noqa: E731
    while time.process_time() - began_s < GIVING_S and leased() < len(fleet.members):
        await dispatcher._look(look_at_active=False, leads=True)
        passes += 1
    await settled(dispatcher)
    used_s = time.process_time() - began_s
    return {"leases": leased(), "lease_ms": round(1e3 * used_s / max(1, leased()), 2), "passes": passes}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--label", default="after")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    rows = []
    for robots in asked.robots:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(asyncio.run(costs(robots, Path(folder))))
            print(json.dumps(rows[-1]), flush=True)
    print(Path(services.__file__).parents[1])
    if asked.out:
        kept = json.loads(asked.out.read_text()) if asked.out.exists() else {}
        asked.out.write_text(json.dumps(kept | {asked.label: rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
