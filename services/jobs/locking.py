"""One mover at a time for each job: whoever moves a job or its trials takes the job's row first, and trials only then.

On SQLite there is one writer anyway. On PostgreSQL each statement sees what was committed before it began, so that after the
lock is had everything of the job is as its last mover left it; and since all take the rows in this order, none waits for
another that waits for it. A transaction that moves several jobs is a dispatcher's, and dispatchers take turns.
"""

from sqlalchemy import bindparam, select
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.postgres import is_postgres
from services.database.tables import job, trial

_JOB = select(job.c.number).where(job.c.number == bindparam("of_job")).with_for_update()
_JOB_OF = (
    select(job.c.number)
    .join(trial, trial.c.job_number == job.c.number)
    .where(trial.c.trial_id == bindparam("of_trial"))
    .with_for_update(of=job)
)


async def lock_job(tx: AsyncConnection, job_number: int) -> None:
    """Waits until nobody else moves the job; holds until the transaction ends."""
    if is_postgres(tx):
        await tx.execute(_JOB, {"of_job": job_number})


async def lock_job_of(tx: AsyncConnection, trial_id: str) -> None:
    """The same for the job of a trial; nothing when there is no such trial."""
    if is_postgres(tx):
        await tx.execute(_JOB_OF, {"of_trial": trial_id})
