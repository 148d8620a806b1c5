"""A job's history: each change of a job writes one numbered event in the same transaction."""

from typing import Any

from sqlalchemy import Boolean, Integer, bindparam, func, insert, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection
from sqlalchemy.sql.dml import ReturningUpdate

from api_schemas.job import JobEvent, JobState
from services.database.rows import AnyRow
from services.database.tables import event, job

PAGE = 500


COUNTS = ("trials_done", "trials_active", "successes", "policy_faults", "platform_faults")
MARKS = ("state", "started_at", "ended_at", "reason")
_NO_CHANGE: dict[str, Any] = {f"add_{name}": 0 for name in COUNTS} | {f"set_{name}": None for name in MARKS} | {"cancel": False}


def _change() -> ReturningUpdate[Any]:
    """One statement for every change of a job, so that it is built and compiled once, not at each of a job's events."""
    counts = {name: job.c[name] + bindparam(f"add_{name}", type_=Integer) for name in COUNTS}
    marks = {name: func.coalesce(bindparam(f"set_{name}", type_=job.c[name].type), job.c[name]) for name in MARKS}
    cancel = or_(job.c.cancel_requested, bindparam("cancel", type_=Boolean))
    changed = update(job).where(job.c.number == bindparam("of_job"))
    return changed.values(last_event=job.c.last_event + 1, cancel_requested=cancel, **counts, **marks).returning(*job.c)


_CHANGE = _change()
_WRITE = insert(event)


async def record(
    tx: AsyncConnection,
    at: str,
    job_number: int,
    kind: str,
    text: str,
    *,
    ordinal: int | None = None,
    robot: str | None = None,
    **changes: Any,
) -> AnyRow:
    """Changes the job's row and writes the event that says so; gives the job's row as it is now.

    ``changes`` are ``add_<count>`` for the names in ``COUNTS``, ``set_<mark>`` for those in ``MARKS``, and ``cancel``.
    The event's number comes from the job's own row, so numbers follow the order of commits also where writers are many.
    """
    now = (await tx.execute(_CHANGE, _NO_CHANGE | changes | {"of_job": job_number})).one()
    written = {
        "job_number": job_number,
        "id": now.last_event,
        "at": at,
        "kind": kind,
        "trial_ordinal": ordinal,
        "robot": robot,
        "text": text,
        "trials_done": now.trials_done,
        "successes": now.successes,
        "state": now.state,
    }
    await tx.execute(_WRITE, written)
    return now


async def events_after(connection: AsyncConnection, job_number: int, after: int) -> tuple[JobEvent, ...]:
    """The job's events numbered above ``after``, in order, at most ``PAGE``."""
    wanted = (
        select(event, job.c.job_id, job.c.trials)
        .join(job, job.c.number == event.c.job_number)
        .where(event.c.job_number == job_number, event.c.id > after)
        .order_by(event.c.id)
        .limit(PAGE)
    )
    return tuple(_shown(row) for row in await connection.execute(wanted))


def _shown(row: AnyRow) -> JobEvent:
    return JobEvent(
        id=row.id,
        job_id=row.job_id,
        at=row.at,
        kind=row.kind,
        trial_ordinal=row.trial_ordinal,
        robot=row.robot,
        text=row.text,
        trials_done=row.trials_done,
        trials=row.trials,
        successes=row.successes,
        state=JobState(row.state),
    )
