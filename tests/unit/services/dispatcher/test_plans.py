"""A long queue is never read from end to end for one claim, also when PostgreSQL plans without knowing what it is asked."""

import pytest
from sqlalchemy import insert, text, update

from api_schemas.trial import TrialState
from services.database.tables import job, policy, trial
from services.dispatcher import queue
from services.dispatcher.finding import find_trial
from tests.benchmarks.claim_cost import JOB, POLICY, TRIAL
from tests.unit.services.conftest import leased_to

JOBS, TRIALS, CLAIMS = 100, 100, 24
_SCANS = text("SELECT seq_scan FROM pg_stat_user_tables WHERE relname = 'trial'")


async def scans(database):
    """How often the whole table of trials was read."""
    await database.close()  # a connection counts when it ends; the next use opens others
    async with database.read() as connection:
        return (await connection.execute(_SCANS)).scalar_one()


@pytest.mark.parametrize("new_database", ["postgres"], indirect=True)  # SQLite plans without statistics
async def test_a_claim_reads_the_queue_through_its_indexes(new_database, fleet_of):
    rows = [
        {"trial_id": f"{number}-{ordinal}", "job_number": number, "ordinal": ordinal, "seed": ordinal, "owner": f"o{number % 5}"}
        | TRIAL
        for number in range(1, JOBS + 1)
        for ordinal in range(TRIALS)
    ]
    jobs = [{"number": n, "job_id": f"j{n}", "owner": f"o{n % 5}", "seed": n, "trials": TRIALS} | JOB for n in range(1, JOBS + 1)]
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(job), jobs)
        await tx.execute(insert(trial), rows)
    async with new_database.read() as connection:
        await connection.execute(text("VACUUM ANALYZE"))
    fleet, before = fleet_of("a", "b"), await scans(new_database)
    for number in range(CLAIMS):  # a statement's plan is made for all values from the sixth time on
        robot, now_s = "ab"[number % 2], 1000.0 + number
        for member in fleet.members.values():
            member.seen_s = now_s
        async with new_database.write() as tx:
            found = await find_trial(tx, robot, fleet.seen(now_s))
            claim = await leased_to(tx, now_s, found[0], robot, departure=found[1], lease_s=15.0)
            assert await queue.drawn_robots(tx) <= {"a", "b"}
            done = update(trial).where(trial.c.trial_id == claim.trial_id)
            await tx.execute(done.values(state=TrialState.DONE))
    assert await scans(new_database) == before
