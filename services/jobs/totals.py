"""How much there is to do and how much was done, over all jobs."""

from dataclasses import dataclass

from sqlalchemy import and_, case, func, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.trial import Fault, TrialState
from services.database.tables import job, trial
from services.jobs.lease import UNENDED

LEFT = job.c.trials - job.c.trials_done - job.c.trials_active


@dataclass(frozen=True)
class Work:
    """Jobs by state, and the trials of those that are not over.

    ``oldest_queued_s`` is the age of the oldest job of which a trial waits.
    """

    jobs: dict[str, int]
    trials_queued: int
    trials_running: int
    oldest_queued_s: float | None


async def work_of(connection: AsyncConnection, now_s: float) -> Work:
    """What there is to do now."""
    jobs = (await connection.execute(select(job.c.state, func.count()).group_by(job.c.state))).all()
    unended = select(func.sum(LEFT), func.sum(job.c.trials_active))
    unended = unended.where(job.c.state.in_(UNENDED), job.c.cancel_requested.is_(False))
    queued, running = (await connection.execute(unended)).one()
    waits = select(func.min(job.c.created_s)).where(job.c.state.in_(UNENDED), job.c.cancel_requested.is_(False), LEFT > 0)
    oldest = (await connection.execute(waits)).scalar()
    counted = {row[0]: row[1] for row in jobs}
    return Work(
        jobs={str(state): counted.get(state, 0) for state in JobState},
        trials_queued=queued or 0,
        trials_running=running or 0,
        oldest_queued_s=None if oldest is None else max(0.0, now_s - oldest),
    )


async def robots_wished(connection: AsyncConnection, user_trials_at_once: int | None) -> int:
    """How many trials could run at the same moment, had the farm a robot for each: what it is scaled by.

    Trials that are held back until a question asks for them could not; of a job that stays on one robot one could.
    """
    held = select(trial.c.job_number, func.count().label("held")).where(trial.c.state == TrialState.HELD)
    held = held.group_by(trial.c.job_number).subquery()
    could_run = LEFT + job.c.trials_active - func.coalesce(held.c.held, 0)
    on_one_robot = or_(job.c.robot.is_not(None), job.c.any_robot.is_(True))
    of_job = case((and_(on_one_robot, could_run > 1), 1), else_=could_run)
    wanted = select(func.sum(of_job)).select_from(job.outerjoin(held, held.c.job_number == job.c.number))
    wanted = wanted.where(job.c.state.in_(UNENDED), job.c.cancel_requested.is_(False)).group_by(job.c.owner)
    loads = [int(row[0]) for row in await connection.execute(wanted)]
    return sum(each if user_trials_at_once is None else min(each, user_trials_at_once) for each in loads)


async def attempts_ended(connection: AsyncConnection) -> dict[Fault, int]:
    """How many attempts have ended, by fault, as the rows of jobs count them."""
    counted = (job.c.trials_done, job.c.policy_faults, job.c.platform_faults)
    row = (await connection.execute(select(*(func.coalesce(func.sum(each), 0) for each in counted)))).one()
    done, policy, platform = map(int, row)
    return {Fault.NONE: done - policy, Fault.POLICY: policy, Fault.PLATFORM: platform}


@dataclass(frozen=True)
class UserLoad:
    """Unended jobs of one user, and their trials."""

    owner: str
    jobs: int
    waiting: int
    running: int


async def load_by_user(connection: AsyncConnection) -> list[UserLoad]:
    """Users with trials in the queue or on robots, the busiest first."""
    waiting, running = func.sum(LEFT), func.sum(job.c.trials_active)
    wanted = select(job.c.owner, func.count(), waiting, running).where(job.c.state.in_(UNENDED)).group_by(job.c.owner)
    rows = (await connection.execute(wanted)).all()
    loads = [UserLoad(row[0], row[1], max(0, row[2]), row[3]) for row in rows]
    return sorted(loads, key=lambda each: (-each.running - each.waiting, each.owner))
