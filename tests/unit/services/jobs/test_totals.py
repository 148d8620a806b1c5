"""How many robots the queue wishes for: as many trials as could run at once."""

import pytest
from sqlalchemy import insert

from api_schemas.trial import TrialState
from services.database.tables import job, policy, trial
from services.jobs.totals import robots_wished
from tests.unit.services.dispatcher.conftest import JOB, POLICY

QUEUED = {"owner": "ann", "trials": 10, "state": "queued", "trials_done": 2, "trials_active": 3}
CASES = {
    "what waits and what runs": ([QUEUED], None, 8),
    "of each user so many at the most": ([QUEUED, QUEUED, QUEUED | {"owner": "bob"}], 10, 18),
    "all that is left of several": ([QUEUED, QUEUED], None, 16),
    "one robot for a job that stays on it": ([QUEUED | {"robot": "robot-1"}, QUEUED | {"any_robot": True}], None, 2),
    "nothing for what is over or about to be": ([QUEUED | {"state": "succeeded"}, QUEUED | {"cancel_requested": True}], None, 0),
    "an empty queue": ([], None, 0),
}


@pytest.fixture
async def tx(new_database):
    """A transaction on a farm that knows one policy."""
    async with new_database.write() as begun:
        await begun.execute(insert(policy).values(POLICY))
        yield begun


@pytest.mark.parametrize("what", CASES)
async def test_a_robot_for_each_trial_that_could_run(tx, what):
    jobs, limit, wished = CASES[what]
    for number, values in enumerate(jobs, start=1):
        await tx.execute(insert(job).values(JOB | values | {"number": number, "job_id": f"j{number}"}))
    assert await robots_wished(tx, limit) == wished


async def test_no_robot_for_trials_that_a_question_may_never_need(tx):
    await tx.execute(insert(job).values(JOB | QUEUED | {"trials_done": 0, "trials_active": 0}))
    states = [TrialState.QUEUED] * 4 + [TrialState.HELD] * 6
    rows = [{"trial_id": f"j1-{at}", "job_number": 1, "ordinal": at, "seed": at, "fence": 0} for at in range(10)]
    rows = [row | {"robot_order": "[]", "state": state} for row, state in zip(rows, states, strict=True)]
    await tx.execute(insert(trial), rows)
    assert await robots_wished(tx, None) == 4
