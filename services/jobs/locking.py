"""One mover at a time for each job: whoever moves a job or its trials takes the job's row first, and trials only then.

On SQLite there is one writer anyway. On PostgreSQL each statement sees what was committed before it began, so that after the
lock is had everything of the job is as its last mover left it; and since all take the rows in this order, none waits for
another that waits for it. A transaction that moves several jobs is a dispatcher's, and dispatchers take turns.
"""

from collections.abc import Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

from sqlalchemy import Column, ColumnElement, bindparam, select, update
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
_JOBS_OF = (
    select(job.c.number)
    .where(
        job.c.number.in_(
            select(trial.c.job_number).where(trial.c.trial_id.in_(bindparam("of_trials", expanding=True))).scalar_subquery()
        )
    )
    .order_by(job.c.number)
    .with_for_update()
)


_known: WeakKeyDictionary[object, set[int | str]] = WeakKeyDictionary()
"""Of each transaction that runs the locks that it has, by the job's number or the id of one of its trials.

A row's lock lasts as long as its transaction, and to ask for it again is a way to the server for nothing. No savepoint, which may
be taken back by itself, takes such a lock.
"""


def _holds(tx: AsyncConnection) -> set[int | str]:
    return _known.setdefault(tx.sync_connection.get_transaction(), set()) if tx.sync_connection is not None else set()


async def lock_job(tx: AsyncConnection, job_number: int) -> None:
    """Waits until nobody else moves the job; holds until the transaction ends."""
    if is_postgres(tx) and job_number not in (held := _holds(tx)):
        await tx.execute(_JOB, {"of_job": job_number})
        held.add(job_number)


async def lock_job_of(tx: AsyncConnection, trial_id: str) -> None:
    """The same for the job of a trial; nothing when there is no such trial."""
    if is_postgres(tx) and trial_id not in (held := _holds(tx)):
        await tx.execute(_JOB_OF, {"of_trial": trial_id})
        held.add(trial_id)


async def lock_job_of_all(tx: AsyncConnection, trial_ids: Sequence[str]) -> None:
    """The same for trials that are all of one job."""
    if is_postgres(tx):
        await tx.execute(_JOBS_OF, {"of_trials": trial_ids})
        _holds(tx).update(trial_ids)


async def change_free(
    tx: AsyncConnection, key: Column[Any], which: Sequence[ColumnElement[bool]], values: Mapping[str, Any]
) -> bool:
    """Changes rows without their jobs: in a transaction of its own, and only those that nobody else is changing now.

    Args:
        tx: the transaction.
        key: the primary key of the rows' table.
        which: what holds of the rows, and no longer once they are changed.
        values: what they get.

    Returns:
        Whether that was all of them.
    """
    # In the order of their keys, beside others that do the same; as a part of the update it is looked for once.
    free = select(key).where(*which).order_by(key).with_for_update(skip_locked=True).cte("free")
    await tx.execute(update(key.table).where(key.in_(select(free.c[key.name]))).values(dict(values)))
    return (await tx.execute(select(key).where(*which).limit(1))).first() is None
