"""What it costs to give a robot its next trial when 400 trials are queued, and when 400,000 are; on SQLite and PostgreSQL.

    python -m tests.benchmarks.claim_cost --out claim-cost.json

20 users share the queue and one of them has half of it. Claims in the small and in the large queue alternate, so that
whatever else the machine does meets both; a ratio is of the medians within one run. A claim is the dispatcher's transaction
from looking for a trial to its commit, which does not wait for the disk here: its time would hide what the queue costs. A
look is what the dispatcher reads whenever it wakes.
"""

import argparse
import asyncio
import json
import platform
import random
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from sqlalchemy import insert, text, update

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from api_schemas.trial import TrialState
from services.database.database import Database, migrate
from services.database.tables import job, policy, trial
from services.dispatcher import queue
from services.dispatcher.finding import find_trial
from services.jobs import lease
from services.jobs.fleet import Fleet
from services.jobs.order import trial_seed
from tests.homes import QUICK, postgres_server

ROBOTS = tuple(f"robot-{number}" for number in range(4))
USERS, JOBS_OF, AT_ONCE = 20, (10, 40), 10_000
"""The few are in smaller jobs, so that all users have some of them too."""
LIMIT = 1.5
D = "d" * 64
POLICY = {"digest": D, "name": "p", "weights_format": "onnx", "weights_sha256": D, "weights_bytes": 1, "graph_sha256": D}
POLICY |= {"manifest": "{}", "warnings": "[]", "owner": "o", "created_at": "now"}
JOB = {"state": "queued", "policy": D, "policy_name": "p", "task": "push", "seed_drawn_by_server": False}
JOB |= {"created_at": "now", "created_s": 0.0}
TRIAL = {"state": TrialState.QUEUED, "fence": 0, "faults": 0, "robot_order": "[]"}


async def fill(url, trials, each_job):
    """A database with so many queued trials in jobs of ``each_job``; user 0 has every second job."""
    await migrate(url)
    database = Database(url)
    owners = [f"user-{0 if number % 2 else number // 2 % USERS:02d}" for number in range(trials // each_job)]
    jobs: list[dict[str, Any]] = [
        {"number": n, "job_id": f"j{n}", "owner": owner, "seed": n, "trials": each_job} | JOB for n, owner in enumerate(owners, 1)
    ]
    rows = [
        {"trial_id": f"{each['job_id']}-{ordinal:03d}", "job_number": each["number"], "owner": each["owner"], "ordinal": ordinal}
        | {"seed": trial_seed(each["seed"], ordinal)}
        | TRIAL
        for each in jobs
        for ordinal in range(each_job)
    ]
    async with database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(job), jobs)
        for start in range(0, len(rows), AT_ONCE):
            await tx.execute(insert(trial), rows[start : start + AT_ONCE])
    if database.is_shared:
        async with database.read() as connection:
            await connection.execute(text("VACUUM ANALYZE"))  # as autovacuum does within a minute
    return database


def idle_fleet():
    fleet = Fleet()
    for robot in ROBOTS:
        fleet.token_changed(robot, present=True, now_s=0.0)
        fleet.heard(Heartbeat(robot=robot, instance="one", pid=1, host="h", state=RobotState.IDLE), 0.0)
    return fleet


async def claim(database, robot, number):
    """Seconds until the robot's next lease is committed; its trial is over when this returns."""
    fleet, began = idle_fleet(), time.perf_counter()
    async with database.write(lasting=False) as tx:
        found = await find_trial(tx, robot, fleet.seen(1.0))
        assert found is not None, "there are trials enough"
        leases = lease.Leases(tx, 1.0 + number, 15.0)
        await lease.end_turn(tx, 1.0 + number, found[0].owner)
        claimed = await leases.write(found[0], robot, found[1])
        await leases.finish()
    took_s = time.perf_counter() - began
    assert claimed is not None, "nobody else claims"
    async with database.write(lasting=False) as tx:
        done = update(trial).where(trial.c.trial_id == claimed.trial_id).values(state=TrialState.DONE)
        await tx.execute(done)
    return took_s


async def look(database):
    """Seconds of what the dispatcher reads whenever it wakes."""
    began = time.perf_counter()
    async with database.read() as connection:
        await queue.active(connection)
        await queue.pinned(connection)
        await queue.drawn_for(connection, [])
        assert await queue.anything_queued(connection)
    return time.perf_counter() - began


async def measure(urls, counts, claims):
    databases = [await fill(*given) for given in zip(urls, counts, JOBS_OF, strict=True)]
    times = {"claim": ([], []), "look": ([], [])}
    order = random.Random(1).choices(ROBOTS, k=claims)
    for number, robot in enumerate(order):
        for which, database in enumerate(databases):
            times["claim"][which].append(await claim(database, robot, number))
            times["look"][which].append(await look(database))
    for database in databases:
        await database.close()
    return {what: summary(*measured) for what, measured in times.items()}


def summary(few, many):
    medians = [statistics.median(few), statistics.median(many)]
    p99 = [statistics.quantiles(each, n=100)[98] for each in (few, many)]
    return {
        "few_median_ms": round(1e3 * medians[0], 3),
        "many_median_ms": round(1e3 * medians[1], 3),
        "ratio": round(medians[1] / medians[0], 3),
        "few_p99_ms": round(1e3 * p99[0], 3),
        "many_p99_ms": round(1e3 * p99[1], 3),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--many", type=int, default=400_000)
    parser.add_argument(
        "--claims", type=int, default=50, help="so few that no user of the 400 runs out of trials: then less is drawn there"
    )
    asked = parser.parse_args()
    counts, found = (400, asked.many), {}
    with tempfile.TemporaryDirectory() as folder, postgres_server(*QUICK[:4]) as postgres:
        urls = [f"sqlite+aiosqlite:///{Path(folder) / name}.sqlite" for name in ("few", "many")]
        found["sqlite"] = asyncio.run(measure(urls, counts, asked.claims))
        asyncio.run(postgres.run("CREATE DATABASE few"))
        asyncio.run(postgres.run("CREATE DATABASE many"))
        found["postgres"] = asyncio.run(measure([postgres.url("few"), postgres.url("many")], counts, asked.claims))
    result = {
        "trials": counts,
        "users": USERS,
        "trials_of_a_job": JOBS_OF,
        "robots": len(ROBOTS),
        "claims": asked.claims,
        "limit": LIMIT,
    } | found
    result |= {"holds": all(found[home]["claim"]["ratio"] <= LIMIT for home in found), "machine": platform.machine()}
    body = json.dumps(result, indent=2)
    print(body)
    if asked.out:
        asked.out.write_text(body + "\n")


if __name__ == "__main__":
    main()
