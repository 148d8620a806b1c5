"""Where a queued job stands when users take turns, and about how long it waits for its first trial."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.trial import AttemptState
from services.database.rows import AnyRow
from services.database.tables import NORMAL_RANK, attempt, job, turn
from services.jobs.lease import UNENDED

LATEST = 40
"""A trial lasts as long as so many of the latest did on average."""
NEVER_S = -1.0

_left = job.c.trials - job.c.trials_done - job.c.trials_active
_WAITING = (job.c.state.in_(UNENDED), job.c.cancel_requested.is_(False), _left > 0)
_BEFORE = (
    select(
        job.c.number,
        (func.sum(_left).over(partition_by=(job.c.owner, job.c.priority), order_by=job.c.number) - _left).label("own"),
    )
    .where(*_WAITING)
    .subquery()
)
_USERS = (
    select(job.c.owner, job.c.priority, func.sum(_left).label("trials"), func.sum(job.c.trials_active).label("running"))
    .add_columns(func.coalesce(func.max(turn.c.served_s), NEVER_S).label("served_s"))
    .outerjoin(turn, turn.c.owner == job.c.owner)
    .where(*_WAITING)
    .group_by(job.c.owner, job.c.priority)
)
_LATEST = (
    select(attempt.c.started_at, attempt.c.ended_at)
    .where(attempt.c.state == AttemptState.ACCEPTED)
    .order_by(attempt.c.job_number.desc())
    .limit(LATEST)
)


@dataclass(frozen=True)
class User:
    """A user with trials of one priority in the queue, ``running`` more on robots, and when one of theirs was leased last."""

    owner: str
    trials: int
    running: int
    served_s: float
    rank: int = NORMAL_RANK


@dataclass(frozen=True)
class Ahead:
    """How many trials robots take before a job's first, its owner's running ones, and the seconds this may last if known."""

    trials: int
    running_of_owner: int = 0
    wait_s: float | None = None


async def ahead_of(connection: AsyncConnection, rows: Sequence[AnyRow], robots: int) -> dict[int, Ahead]:
    """What stands before each queued job of ``rows``, by its number.

    Args:
        connection: reads the queue.
        rows: jobs in any state.
        robots: how many are in service.
    """
    queued = {row.number: (row.owner, row.priority) for row in rows if row.state == JobState.QUEUED and not row.cancel_requested}
    if not queued:
        return {}
    own = select(_BEFORE.c.number, _BEFORE.c.own).where(_BEFORE.c.number.in_(list(queued)))
    before = {row.number: row.own for row in await connection.execute(own)}
    users = [User(row.owner, row.trials, row.running, row.served_s, row.priority) for row in await connection.execute(_USERS)]
    trial_s = mean_s([(row.started_at, row.ended_at) for row in await connection.execute(_LATEST)])
    each_s = None if trial_s is None or robots == 0 else trial_s / robots
    return {number: _ahead(before.get(number, 0), owner, rank, users, each_s) for number, (owner, rank) in queued.items()}


def _ahead(own: int, owner: str, rank: int, users: Sequence[User], each_s: float | None) -> Ahead:
    pressing = sum(user.trials for user in users if user.rank < rank)
    trials = pressing + trials_ahead(own, owner, [user for user in users if user.rank == rank])
    running = sum(user.running for user in users if user.owner == owner)
    return Ahead(trials, running, None if each_s is None else trials * each_s)


def trials_ahead(own: int, owner: str, users: Sequence[User]) -> int:
    """How many trials of its priority are taken before the one that has ``own`` of its owner before it.

    Until then everybody else has as many turns, and one more if this one was served longer ago.
    """
    served_s = next((user.served_s for user in users if user.owner == owner), NEVER_S)
    others = [(user, user.served_s < served_s) for user in users if user.owner != owner]
    return own + sum(min(user.trials, own + int(comes_first)) for user, comes_first in others)


def mean_s(spans: Sequence[tuple[str, str]]) -> float | None:
    """How long the spans between two times are on average, in seconds; None when there are none."""
    lasted_s = [(datetime.fromisoformat(end) - datetime.fromisoformat(start)).total_seconds() for start, end in spans]
    return sum(lasted_s) / len(lasted_s) if lasted_s else None
