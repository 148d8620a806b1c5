"""What the pages ask the database beyond what the API asks: all but the search by text from an index or a few jobs."""

import json
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from sqlalchemy import Select, func, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.trial import AttemptState, OutcomeKind
from services.database.rows import AnyRow
from services.database.tables import attempt, event, job, trial
from services.jobs.lease import UNENDED

RECENT_JOBS = 300
RECENT_ATTEMPTS = 2000
"""What a robot did lately is looked for in the newest jobs, as far as these two reach."""
NOT_JUDGED = frozenset({OutcomeKind.RECORDED, OutcomeKind.CANCELLED})
LEFT = job.c.trials - job.c.trials_done - job.c.trials_active


@dataclass(frozen=True)
class UserLoad:
    """What one user has in the farm."""

    owner: str
    jobs: int
    waiting: int
    running: int


@dataclass(frozen=True)
class Ended:
    """One attempt that was accepted."""

    robot: str
    succeeded: bool
    ended_at: str


async def load_by_user(connection: AsyncConnection) -> list[UserLoad]:
    """Users with trials in the queue or on robots, the busiest first."""
    waiting, running = func.sum(LEFT), func.sum(job.c.trials_active)
    wanted = select(job.c.owner, func.count(), waiting, running).where(job.c.state.in_(UNENDED)).group_by(job.c.owner)
    rows = (await connection.execute(wanted)).all()
    loads = [UserLoad(row[0], row[1], max(0, row[2]), row[3]) for row in rows]
    return sorted(loads, key=lambda each: (-each.running - each.waiting, each.owner))


async def recently_ended(connection: AsyncConnection) -> list[Ended]:
    """Trials that were judged, of the newest jobs, the last first."""
    newest = select(job.c.number, job.c.trials_done).where(job.c.trials_done > 0).order_by(job.c.number.desc()).limit(RECENT_JOBS)
    numbers, found = [], 0
    for row in await connection.execute(newest):
        numbers.append(row.number)
        found += row.trials_done
        if found >= RECENT_ATTEMPTS:
            break
    wanted = (
        select(attempt.c.robot, attempt.c.outcome, attempt.c.ended_at)
        .where(attempt.c.job_number.in_(numbers), attempt.c.state == AttemptState.ACCEPTED)
        .order_by(attempt.c.ended_at.desc())
        .limit(RECENT_ATTEMPTS)
    )
    ended = []
    for row in await connection.execute(wanted):
        kind = json.loads(row.outcome)["kind"]
        if kind not in NOT_JUDGED:
            ended.append(Ended(row.robot, kind == OutcomeKind.SUCCEEDED, row.ended_at))
    return ended


async def recently_given(connection: AsyncConnection, since: str) -> Sequence[str]:
    """When leases were given that robots took, of the newest jobs, since a moment (ISO 8601)."""
    newest = select(job.c.number).where(job.c.started_at.is_not(None)).order_by(job.c.number.desc()).limit(RECENT_JOBS)
    wanted = select(attempt.c.started_at).where(
        attempt.c.job_number.in_(newest), attempt.c.started_at >= since, attempt.c.state != AttemptState.DECLINED
    )
    return (await connection.execute(wanted)).scalars().all()


@dataclass(frozen=True)
class JobFilter:
    """Which jobs a list shows."""

    owner: str | None
    state: JobState | None
    text: str
    before: int | None

    def select(self, limit: int) -> Select[tuple]:
        """The statement, newest first."""
        wanted = select(job).order_by(job.c.number.desc()).limit(limit)
        if self.owner is not None:
            wanted = wanted.where(job.c.owner == self.owner)
        if self.state is not None:
            wanted = wanted.where(job.c.state == self.state)
        if self.before is not None:
            wanted = wanted.where(job.c.number < self.before)
        if self.text:
            columns = (job.c.job_id, job.c.policy_name, job.c.owner, job.c.task, job.c.policy)
            wanted = wanted.where(or_(*(column.icontains(self.text, autoescape=True) for column in columns)))
        return wanted


def owned(job_ids: Collection[str], owner: str) -> Select[tuple]:
    """The statement for those of the jobs that are this owner's."""
    return select(job.c.job_id).where(job.c.job_id.in_(job_ids), job.c.owner == owner)


async def trial_rows(connection: AsyncConnection, number: int) -> Sequence[AnyRow]:
    """All trials of a job, in their order."""
    wanted = select(trial).where(trial.c.job_number == number).order_by(trial.c.ordinal)
    return (await connection.execute(wanted)).all()


async def successes_over_time(connection: AsyncConnection, number: int) -> list[tuple[int, int]]:
    """After each trial that ended: trials done and successes."""
    wanted = select(event.c.trials_done, event.c.successes).where(event.c.job_number == number, event.c.kind == "trial_done")
    rows = (await connection.execute(wanted.order_by(event.c.id))).all()
    return [(row[0], row[1]) for row in rows]


def by_robot(ended: Sequence[Ended], last: int) -> dict[str, tuple[int, int]]:
    """Successes and trials of each robot's last trials."""
    of: dict[str, list[bool]] = defaultdict(list)
    for each in ended:
        if len(of[each.robot]) < last:
            of[each.robot].append(each.succeeded)
    return {robot: (sum(done), len(done)) for robot, done in of.items()}
