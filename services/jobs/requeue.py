"""A job that failed by the platform's fault is put back into the queue, with what it has achieved."""

from sqlalchemy import select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import EventKind, JobState
from api_schemas.trial import TrialState
from services.database.database import Database
from services.database.tables import event, job, trial, webhook
from services.errors import Conflict
from services.files.store import FileStore
from services.jobs import events, pinning
from services.jobs.clock import iso

NAMED = 5


async def check_logs(database: Database, files: FileStore, job_number: int) -> None:
    """Raises where the report of a failed job, had it gone on, would name logs that are gone.

    Raises:
        Conflict: logs of what it has done are not in the store.
    """
    done = select(job.c.job_id, trial.c.ordinal, trial.c.log_sha256).join(job, job.c.number == trial.c.job_number)
    done = done.where(job.c.number == job_number, job.c.state == JobState.FAILED, trial.c.state == TrialState.DONE)
    async with database.read() as connection:
        rows = (await connection.execute(done.where(trial.c.log_sha256.is_not(None)).order_by(trial.c.ordinal))).all()
    gone = [row.ordinal for row in rows if await files.size(row.log_sha256) is None]
    if gone:
        some = ", ".join(map(str, gone[:NAMED])) + (" …" if len(gone) > NAMED else "")
        detail = f"Logs of job {rows[0].job_id} are gone (trial {some}) and its report would name them; submit a new job."
        raise Conflict("logs-gone", detail, trials=gone)


async def requeue(tx: AsyncConnection, now_s: float, job_number: int) -> None:
    """Puts the trials that a failed job has not done back into the queue; each may fail anew as often as before.

    Raises:
        Conflict: the job has not failed, or robots are still stopping trials of it.
    """
    row = (await tx.execute(select(job).where(job.c.number == job_number).with_for_update())).one()
    if row.state != JobState.FAILED:
        raise Conflict(
            "job-not-failed", f"Job {row.job_id} is {row.state}; only a failed job can be queued again.", state=row.state
        )
    if row.judged:
        detail = f"Job {row.job_id} was run for a question that is closed; ask it anew with a new job."
        raise Conflict("question-closed", detail)
    if row.trials_active:
        detail = f"Robots are still stopping trials of job {row.job_id}; ask again in a moment."
        raise Conflict("job-stopping", detail, trials_active=row.trials_active)
    state = JobState.QUEUED if row.started_at is None else JobState.RUNNING
    of_job = update(event).where(event.c.job_number == job_number)
    await tx.execute(of_job.where(event.c.kind == EventKind.JOB_ENDED).values(kind=EventKind.JOB_GAVE_UP))
    # Trials that were stopped have told of a failed job too, and whoever reads of one believes that nothing follows.
    await tx.execute(of_job.where(event.c.state == JobState.FAILED).values(state=state))
    left = update(trial).where(trial.c.job_number == job_number, trial.c.state == TrialState.CANCELLED)
    again = await tx.execute(left.values(state=TrialState.QUEUED, faults=0))
    await tx.execute(update(webhook).where(webhook.c.job_number == job_number).values(tries=0, due_s=0.0, said=None))
    if row.any_robot:
        await pinning.unpin(tx, job_number)
    text = f"job queued again by an operator: {again.rowcount} trials are left"
    await tx.execute(update(job).where(job.c.number == job_number).values(ended_at=None, reason=None, created_s=now_s))
    await events.record(tx, iso(now_s), job_number, EventKind.JOB_QUEUED_AGAIN, text, set_state=state)
