"""A job's history: each change of a job writes one numbered event in the same transaction."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Boolean, Integer, bindparam, func, insert, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection
from sqlalchemy.sql.dml import ReturningUpdate

from api_schemas.job import EventKind, JobEvent, JobState
from services.database.rows import AnyRow
from services.database.tables import event, job

PAGE = 500


COUNTS = ("trials_done", "trials_active", "successes", "policy_faults", "platform_faults")
MARKS = ("state", "started_at", "ended_at", "reason")
_NO_CHANGE: dict[str, Any] = {f"add_{name}": 0 for name in COUNTS} | {f"set_{name}": None for name in MARKS} | {"cancel": False}


def _change() -> ReturningUpdate[*tuple[Any, ...]]:
    """One statement for every change of a job, so that it is built and compiled once, not at each of a job's events."""
    counts = {name: job.c[name] + bindparam(f"add_{name}", type_=Integer) for name in COUNTS}
    marks = {name: func.coalesce(bindparam(f"set_{name}", type_=job.c[name].type), job.c[name]) for name in MARKS}
    cancel = or_(job.c.cancel_requested, bindparam("cancel", type_=Boolean))
    last_event = job.c.last_event + bindparam("more_events", type_=Integer)
    changed = update(job).where(job.c.number == bindparam("of_job"))
    return changed.values(last_event=last_event, cancel_requested=cancel, **counts, **marks).returning(*job.c)


_CHANGE = _change()
_WRITE = insert(event)


@dataclass(frozen=True)
class Line:
    """One event of a job."""

    kind: EventKind
    text: str
    ordinal: int | None = None
    robot: str | None = None


async def record(
    tx: AsyncConnection,
    at: str,
    job_number: int,
    kind: EventKind,
    text: str,
    *,
    ordinal: int | None = None,
    robot: str | None = None,
    **changes: Any,
) -> AnyRow:
    """Changes the job's row and writes the event that says so; gives the job's row as it is now. See ``record_all``."""
    return await record_all(tx, at, job_number, [Line(kind, text, ordinal, robot)], **changes)


async def record_all(tx: AsyncConnection, at: str, job_number: int, lines: Sequence[Line], **changes: Any) -> AnyRow:
    """Changes the job's row and writes the events that say so, in their order; gives the job's row as it is now.

    ``changes`` are ``add_<count>`` for the names in ``COUNTS``, ``set_<mark>`` for those in ``MARKS``, and ``cancel``.
    The events' numbers come from the job's own row, so they follow the order of commits also where writers are many.
    """
    now = (await tx.execute(_CHANGE, _NO_CHANGE | changes | {"of_job": job_number, "more_events": len(lines)})).one()
    of_all = {"job_number": job_number, "at": at}
    of_all |= {"trials_done": now.trials_done, "successes": now.successes, "state": now.state}
    written = [
        {"id": number, "kind": line.kind, "trial_ordinal": line.ordinal, "robot": line.robot, "text": line.text} | of_all
        for number, line in enumerate(lines, now.last_event - len(lines) + 1)
    ]
    await tx.execute(_WRITE, written if len(written) > 1 else written[0])
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
