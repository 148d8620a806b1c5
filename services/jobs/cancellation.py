"""A job is cancelled: queued trials at once, running ones when their robots have stopped."""

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import EventKind, JobState
from services.database.tables import job
from services.errors import Conflict
from services.jobs import events
from services.jobs.clock import iso
from services.jobs.completion import cancel_queued, end_cancelled
from services.jobs.lease import UNENDED


async def cancel(tx: AsyncConnection, now_s: float, job_number: int) -> None:
    """Asks for the job's end; asking again changes nothing.

    Raises:
        Conflict: the job has ended in another way.
    """
    row = (await tx.execute(select(job).where(job.c.number == job_number).with_for_update())).one()
    if row.state == JobState.CANCELLED or (row.cancel_requested and row.state in UNENDED):
        return
    if row.state not in UNENDED:
        raise Conflict("job-ended", f"Job {row.job_id} has {row.state} and cannot be cancelled any more.", state=row.state)
    await cancel_queued(tx, job_number)
    text = "cancel asked for" if row.trials_active == 0 else f"cancel asked for; {row.trials_active} running trials stop"
    now = await events.record(tx, iso(now_s), job_number, EventKind.JOB_CANCELLING, text, cancel=True)
    await end_cancelled(tx, now_s, now)
