"""Large jobs: their trials are made page by page, as many ahead of the robots as keep these busy.

``job.trials_made`` says how many exist. It moves in the transaction that makes a page, which is guarded by the number that it
moves from: whoever is killed leaves either none of a page or all of it, and of several processes one makes it.
"""

from collections.abc import Sequence

from sqlalchemy import select, text, update
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow
from services.database.tables import UNFINISHED, job
from services.jobs.goals import TrialDraw
from services.jobs.lease import UNENDED
from services.jobs.making import OfJob, make

PAGES_AHEAD = 4
"""So many pages of a job's trials exist that no robot has yet. A farm of a thousand robots takes one in some seconds; what a
cancelled job takes out of the queue, in one statement, is no more than these."""

_OF_JOB = (job.c.number, job.c.job_id, job.c.state, job.c.seed, job.c.owner, job.c.priority, job.c.cancel_requested)
_COUNTS = (job.c.trials, job.c.trials_made, job.c.trials_done, job.c.trials_active)
_UNFINISHED = select(*_OF_JOB, *_COUNTS).where(text(UNFINISHED)).order_by(job.c.number)


async def unfinished(connection: AsyncConnection) -> Sequence[AnyRow]:
    """The large jobs that have trials to make, to be done, or an end to be written."""
    return (await connection.execute(_UNFINISHED)).all()


def wants_trials(row: AnyRow, page: int) -> bool:
    """Whether a page of a large job's trials is to be made now."""
    if row.state not in UNENDED or row.cancel_requested or row.trials_made >= row.trials:
        return False
    return row.trials_made - row.trials_done - row.trials_active < PAGES_AHEAD * page


def is_done(row: AnyRow) -> bool:
    """Whether nothing but its report is left of a large job."""
    return row.state in UNENDED and not row.cancel_requested and row.trials_done >= row.trials


async def fill(tx: AsyncConnection, row: AnyRow, page: int) -> bool:
    """Makes the next page of a large job's trials; false when somebody else has, or the job has come to its end."""
    made = min(row.trials_made + page, row.trials)
    going = (job.c.state.in_(UNENDED), job.c.cancel_requested.is_(False))
    guarded = update(job).where(job.c.number == row.number, job.c.trials_made == row.trials_made, *going)
    if (await tx.execute(guarded.values(trials_made=made))).rowcount != 1:
        return False
    of = OfJob(row.job_id, row.number, row.seed, row.owner, row.priority)
    await make(tx, of, [TrialDraw()] * (made - row.trials_made), first=row.trials_made)
    return True


async def keep_outcomes(tx: AsyncConnection, row: AnyRow, told: str) -> None:
    """Keeps how the trials of a large job ended that did not succeed as a whole, unless it goes on."""
    guarded = update(job).where(job.c.number == row.number, job.c.state == row.state, job.c.outcomes.is_(None))
    await tx.execute(guarded.values(outcomes=told))
