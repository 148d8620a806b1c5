"""Lists of jobs and trials, and single trials, as the API and the pages ask for them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from sqlalchemy import or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import MAX_CHOSEN, JobState, TaskName
from api_schemas.trial import AttemptState
from services.database.pages import Asked, Page, read_page
from services.database.postgres import is_postgres
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial

MOST_FAULTS = 100
TO_CHOOSE_FROM = 40
"""Jobs that a comparison offers."""


@dataclass(frozen=True)
class JobFilter:
    """The jobs of a list: of one owner, in one state, with a text in a name, a note or an id; None and no text take all."""

    owner: str | None = None
    state: JobState | None = None
    text: str = ""


async def job_page(connection: AsyncConnection, chosen: JobFilter, asked: Asked) -> Page[AnyRow]:
    """Rows of jobs, newest first; the key is the job's number. Only a text is searched for without an index."""
    wanted = select(job)
    if chosen.owner is not None:
        wanted = wanted.where(job.c.owner == chosen.owner)
    if chosen.state is not None:
        wanted = wanted.where(job.c.state == chosen.state)
    if chosen.text:
        columns = (job.c.job_id, job.c.policy_name, job.c.owner, job.c.task, job.c.policy, job.c.name, job.c.note)
        # SQLite's LIKE knows no case as it is, and takes a third of the time that lower() beside it takes.
        contains = "icontains" if is_postgres(connection) else "contains"
        wanted = wanted.where(or_(*(getattr(column, contains)(chosen.text, autoescape=True) for column in columns)))
    return await read_page(connection, wanted, job.c.number, asked)


async def comparable_jobs(connection: AsyncConnection, owner: str | None, first: str | None) -> Sequence[AnyRow]:
    """The newest jobs with a report; with a first one chosen, those of its task, object and seed before the rest."""
    told = (job.c.job_id, job.c.name, job.c.policy_name, job.c.seed, job.c.successes, job.c.trials, job.c.ended_at)
    ended = select(job.c.number, job.c.task, job.c.object, job.c.object_scale, *told)
    ended = ended.where(job.c.state == JobState.SUCCEEDED, job.c.task != TaskName.IDENTIFY)
    if owner is not None:
        ended = ended.where(job.c.owner == owner)
    rows = (await connection.execute(ended.order_by(job.c.number.desc()).limit(TO_CHOOSE_FROM))).all()
    chosen = None if first is None else (await connection.execute(ended.where(job.c.job_id == first))).one_or_none()
    if chosen is None:
        return rows
    same = ended.where(job.c.task == chosen.task, job.c.object == chosen.object, job.c.seed == chosen.seed)
    alike = (await connection.execute(same.order_by(job.c.number.desc()).limit(TO_CHOOSE_FROM))).all()
    known = {row.number for row in alike}
    return [*alike, *(row for row in rows if row.number not in known)]


async def owned(connection: AsyncConnection, job_ids: Collection[str], owner: str) -> frozenset[str]:
    """Those of the jobs that are this owner's."""
    wanted = select(job.c.job_id).where(job.c.job_id.in_(job_ids), job.c.owner == owner)
    return frozenset((await connection.execute(wanted)).scalars())


async def trial_page(connection: AsyncConnection, job_number: int, asked: Asked) -> Page[AnyRow]:
    """Rows of a job's trials in their order; the key is the trial's number."""
    wanted = select(trial).where(trial.c.job_number == job_number)
    return await read_page(connection, wanted, trial.c.ordinal, asked, newest_first=False)


async def trials_of(connection: AsyncConnection, job_number: int) -> Sequence[AnyRow]:
    """Rows of a job's first trials, in their order: of all, unless the job is a large one."""
    return await some_trials(connection, job_number, -1, MAX_CHOSEN)


async def some_trials(connection: AsyncConnection, job_number: int, after: int, most: int) -> Sequence[AnyRow]:
    """Rows of a job's trials in their order, those numbered above ``after``."""
    wanted = select(trial).where(trial.c.job_number == job_number, trial.c.ordinal > after)
    return (await connection.execute(wanted.order_by(trial.c.ordinal).limit(most))).all()


async def job_of(connection: AsyncConnection, job_number: int) -> AnyRow:
    """The row of a job that is there."""
    return (await connection.execute(select(job).where(job.c.number == job_number))).one()


async def platform_faults(connection: AsyncConnection, job_number: int) -> Sequence[AnyRow]:
    """Attempts of a job's unfinished trials that the platform failed, with their trial's ordinal and how often it was tried."""
    wanted = (
        select(attempt, trial.c.ordinal)
        .join(trial, trial.c.trial_id == attempt.c.trial_id)
        .where(attempt.c.job_number == job_number, attempt.c.state == AttemptState.PLATFORM_FAULT, trial.c.outcome.is_(None))
        .order_by(trial.c.faults.desc(), trial.c.ordinal, attempt.c.fence)
    )
    return (await connection.execute(wanted.limit(MOST_FAULTS))).all()


async def trial_row(connection: AsyncConnection, trial_id: str) -> AnyRow | None:
    """A trial's row."""
    return (await connection.execute(select(trial).where(trial.c.trial_id == trial_id))).one_or_none()


async def trial_at(connection: AsyncConnection, job_number: int, ordinal: int) -> AnyRow | None:
    """The row of a job's trial of this number."""
    wanted = select(trial).where(trial.c.job_number == job_number, trial.c.ordinal == ordinal)
    return (await connection.execute(wanted)).one_or_none()
