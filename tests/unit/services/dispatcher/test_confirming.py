"""Leases that robots accepted are written down together, and nobody's is forgotten where the writing fails."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from sqlalchemy import select

from api_schemas.trial import TrialState
from services.database.tables import trial
from services.dispatcher.confirming import Confirming
from services.dispatcher.finding import find_trial
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from tests.unit.services.conftest import leased_to
from tests.unit.services.dispatcher.conftest import add_trials

ROBOTS = ("a", "b", "c")


async def leased(database, fleet):
    """A claim of each robot, and the id of the job."""
    await add_trials(database, [(robot,) for robot in ROBOTS])
    claims = []
    for robot in ROBOTS:
        async with database.write() as tx:
            row, _ = await find_trial(tx, robot, fleet.seen(1000.0))
            claims.append(await leased_to(tx, 1000.0, row, robot, departure=None, lease_s=15.0))
    return claims, row.job_id


async def states(database):
    async with database.read() as connection:
        return (await connection.execute(select(trial.c.state).order_by(trial.c.ordinal))).scalars().all()


class Written:
    """Transactions of which the first ``failing`` fail."""

    def __init__(self, database, failing=0):
        self.database, self.failing, self.count = database, failing, 0

    @asynccontextmanager
    async def write(self, **how):
        self.count += 1
        if self.count <= self.failing:
            raise OSError("the database is away")
        async with self.database.write(**how) as tx:
            yield tx


async def test_what_is_accepted_within_a_moment_is_written_in_one_transaction(database, fleet_of):
    claims, job_id = await leased(database, fleet_of(*ROBOTS, now_s=1000.0))
    written, signals = Written(database), Signals()
    told = []
    signals.tell_others = told.append
    confirming = Confirming(written, FarmClock.start(), signals)
    await asyncio.gather(*(confirming.confirm(claim, job_id) for claim in claims))
    assert (written.count, told) == (1, [job_id])
    assert await states(database) == [TrialState.RUNNING] * 3
    assert not confirming._waiting and not confirming._writing, "nothing is kept of jobs for the life of the process"
    await confirming.confirm(claims[0], job_id)
    assert (written.count, told) == (2, [job_id]), "it runs already, which is no change"


async def test_all_who_wait_hear_that_it_was_not_written_and_the_next_is(database, fleet_of):
    claims, job_id = await leased(database, fleet_of(*ROBOTS, now_s=1000.0))
    confirming = Confirming(Written(database, failing=1), FarmClock.start(), Signals())
    ends = await asyncio.gather(*(confirming.confirm(claim, job_id) for claim in claims[:2]), return_exceptions=True)
    assert [type(each) for each in ends] == [OSError, OSError]
    with pytest.raises(asyncio.CancelledError):
        await cancelled(confirming.confirm(claims[0], job_id))
    await confirming.confirm(claims[2], job_id)
    assert await states(database) == [TrialState.RUNNING, TrialState.LEASED, TrialState.RUNNING]


async def test_a_job_that_cannot_be_written_keeps_no_other_job(database, fleet_of):
    claims, job_id = await leased(database, fleet_of(*ROBOTS, now_s=1000.0))
    confirming = Confirming(Written(database, failing=1), FarmClock.start(), Signals())
    ends = await asyncio.gather(
        confirming.confirm(claims[0], "another"), confirming.confirm(claims[1], job_id), return_exceptions=True
    )
    assert [type(each) for each in ends] == [OSError, type(None)]
    assert await states(database) == [TrialState.LEASED, TrialState.RUNNING, TrialState.LEASED]


async def cancelled(work):
    """Nobody waits for it any more; it is written all the same, with the next."""
    waiting = asyncio.ensure_future(work)
    await asyncio.sleep(0)
    waiting.cancel()
    await waiting
