"""What happened lately, read from an index or from a few jobs."""

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import AttemptState, OutcomeKind
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial

RECENT_JOBS = 300
RECENT_ATTEMPTS = 2000
"""What a robot did lately is looked for in the newest jobs, as far as these two reach."""
INCIDENT_JOBS, RECENT_INCIDENTS = 1000, 500
"""Incidents are looked for in so many of the newest jobs, those without any left out."""
LATEST_OF_LARGE = 10_000
"""Trials of a large job that are looked at, the last that exist; the robots are at these."""
_JOBS = select(job.c.number, job.c.trials_done, job.c.trials_made, job.c.platform_faults).order_by(job.c.number.desc())
NOT_JUDGED = frozenset({OutcomeKind.RECORDED, OutcomeKind.CANCELLED})


@dataclass(frozen=True)
class Ended:
    """One attempt that was accepted."""

    robot: str
    succeeded: bool
    ended_at: str


def _latest_of(jobs: Sequence[AnyRow]) -> ColumnElement[bool]:
    """Attempts of some jobs; of large ones those of their latest trials."""
    of_all = attempt.c.job_number.in_([row.number for row in jobs if row.trials_made is None])
    large = [row for row in jobs if row.trials_made is not None]
    latest = (
        select(trial.c.trial_id).where(trial.c.job_number == row.number, trial.c.ordinal >= row.trials_made - LATEST_OF_LARGE)
        for row in large
    )
    return or_(of_all, *(attempt.c.trial_id.in_(each) for each in latest))


async def recently_ended(connection: AsyncConnection) -> list[Ended]:
    """Trials that were judged, of the newest jobs, the last first."""
    newest = _JOBS.where(job.c.trials_done > 0).limit(RECENT_JOBS)
    jobs, found = [], 0
    for row in await connection.execute(newest):
        jobs.append(row)
        found += row.trials_done
        if found >= RECENT_ATTEMPTS:
            break
    wanted = (
        select(attempt.c.robot, attempt.c.outcome, attempt.c.ended_at)
        .where(_latest_of(jobs), attempt.c.state == AttemptState.ACCEPTED)
        .order_by(attempt.c.ended_at.desc())
        .limit(RECENT_ATTEMPTS)
    )
    ended = []
    for row in await connection.execute(wanted):
        kind = json.loads(row.outcome)["kind"]
        if kind not in NOT_JUDGED:
            ended.append(Ended(row.robot, kind == OutcomeKind.SUCCEEDED, row.ended_at))
    return ended


@dataclass(frozen=True)
class Incident:
    """One attempt that the platform failed: the robot was lost or restarted, or could not go on."""

    robot: str
    trial_id: str
    ended_at: str
    reason: str | None


async def incidents(connection: AsyncConnection) -> list[Incident]:
    """Attempts of the newest jobs that the platform failed, the last first."""
    newest = (await connection.execute(_JOBS.limit(INCIDENT_JOBS))).all()
    hit = [row for row in newest if row.platform_faults > 0][:RECENT_JOBS]
    wanted = (
        select(attempt.c.robot, attempt.c.trial_id, attempt.c.ended_at, attempt.c.reason)
        .where(_latest_of(hit), attempt.c.state == AttemptState.PLATFORM_FAULT, attempt.c.ended_at.is_not(None))
        .order_by(attempt.c.ended_at.desc())
        .limit(RECENT_INCIDENTS)
    )
    return [Incident(row.robot, row.trial_id, row.ended_at, row.reason) for row in await connection.execute(wanted)]


async def recently_given(connection: AsyncConnection, since: str) -> Sequence[str]:
    """When leases were given that robots took, of the newest jobs, since a moment (ISO 8601)."""
    newest = (await connection.execute(_JOBS.where(job.c.started_at.is_not(None)).limit(RECENT_JOBS))).all()
    wanted = select(attempt.c.started_at).where(
        _latest_of(newest), attempt.c.started_at >= since, attempt.c.state != AttemptState.DECLINED
    )
    return (await connection.execute(wanted)).scalars().all()


def by_robot(ended: Sequence[Ended], last: int) -> dict[str, tuple[int, int]]:
    """Successes and trials of each robot's last trials."""
    of: dict[str, list[bool]] = defaultdict(list)
    for each in ended:
        if len(of[each.robot]) < last:
            of[each.robot].append(each.succeeded)
    return {robot: (sum(done), len(done)) for robot, done in of.items()}
