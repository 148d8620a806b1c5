"""What policies achieved at a task over all of their jobs whose seed nobody could choose."""

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import case, distinct, func, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.anytime import rate_sequence
from api_schemas.job import JobState, TaskName
from api_schemas.leaderboard import BoardPhysics, BoardRow, Contest
from api_schemas.physics import ObjectName
from api_schemas.success_rate import wilson
from services.database.rows import AnyRow
from services.database.tables import job, physics, policy_owner, rung
from services.errors import NotFound
from services.jobs.physics import NOW

LEVEL = 0.80
MOST_ROWS = 200
CANCELLED = job.c.state == JobState.CANCELLED
TRIALS = case((CANCELLED, job.c.trials), else_=func.coalesce(job.c.counted_trials, job.c.trials_done))
SUCCESSES = func.coalesce(job.c.counted_successes, job.c.successes)
"""A seed that was drawn may be seen before the first trial, and what it stands for may be tried at home: whoever cancels a job
has all of its trials counted, those that were not done as not succeeded. A question counts the trials up to its answer."""
COUNTED = (
    job.c.seed_drawn_by_server.is_(True),
    job.c.own_goals.is_(False),
    job.c.policy.is_not(None),
    or_(job.c.trials_done > 0, CANCELLED),
    job.c.number.not_in(select(rung.c.job_number)),  # looked up in a list that is made once, not searched for each job
    job.c.physics.is_not(None),
    job.c.physics_mixed.is_(False),
)
"""Rungs of ladders do not count: all have one seed, and the first of them shows the others what it is worth. Nor do jobs of
which nobody knows on what physics their trials were done, or that were begun on one and ended on another."""


@dataclass(frozen=True)
class Wanted:
    """A task and an object, on one physics of the farm; None is the one that it has now."""

    task: TaskName
    object: ObjectName = ObjectName.CUBE
    object_scale: float = 1.0
    physics: int | None = None


@dataclass(frozen=True)
class Board:
    """The best policies, how many were tried at all, and on which physics; that is None before a robot told what it has."""

    physics: BoardPhysics | None
    policies: int
    rows: tuple[BoardRow, ...]


async def contests(connection: AsyncConnection) -> tuple[Contest, ...]:
    """The tasks, objects and physics that at least one policy was tried at with a seed of the server's; now's physics first."""
    by = (job.c.task, job.c.object, job.c.object_scale, job.c.physics)
    counts = select(*by, func.count(distinct(job.c.policy)).label("policies")).where(*COUNTED).group_by(*by).subquery()
    told = (physics.c.number, physics.c.name, physics.c.form, physics.c.first_told_at, (physics.c.number == NOW).label("is_now"))
    wanted = select(counts, *told).join(physics, physics.c.number == counts.c.physics)
    order = (physics.c.told_s.desc(), physics.c.number.desc(), counts.c.task, counts.c.object, counts.c.object_scale)
    return tuple(
        Contest(
            task=TaskName(row.task),
            object=ObjectName(row.object),
            object_scale=row.object_scale,
            physics=_physics(row),
            policies=row.policies,
        )
        for row in await connection.execute(wanted.order_by(*order))
    )


async def board(connection: AsyncConnection, wanted: Wanted, sees_only: str | None) -> Board:
    """The best policies of a task on one physics; ``sees_only`` is the owner whose policies alone are named.

    They are ordered by the lower bound of Wilson's 80 % interval, so that luck in a few trials does not lead; by that of the
    confidence sequence where a question may have ended one of their jobs, since it ends when the rate looks as wanted. The
    counts are those that each job keeps of itself: no trial is read, and one row a policy comes back.

    Raises:
        NotFound: the farm never had a physics of this number.
    """
    which = NOW if wanted.physics is None else wanted.physics
    told = select(physics, (physics.c.number == NOW).label("is_now")).where(physics.c.number == which)
    shown_physics = (await connection.execute(told)).one_or_none()
    if shown_physics is None and wanted.physics is not None:
        detail = f"This farm never had physics number {wanted.physics}; GET /v1/leaderboard lists those with results."
        raise NotFound("physics-not-found", detail)
    of_task = (
        job.c.task == wanted.task,
        job.c.object == wanted.object,
        job.c.object_scale == wanted.object_scale,
        job.c.physics == (None if shown_physics is None else shown_physics.number),
    )
    sums = func.count().label("jobs"), func.sum(TRIALS).label("trials"), func.sum(SUCCESSES).label("successes")
    judged = func.max(case((job.c.judged, 1), else_=0)).label("judged")
    names = (
        func.min(job.c.policy_name).label("name"),
        func.min(job.c.owner).label("owner"),
        func.max(job.c.created_at).label("last"),
    )
    pooled = select(job.c.policy, *sums, judged, *names).where(*COUNTED, *of_task).group_by(job.c.policy)
    rows = (await connection.execute(pooled)).all()
    ranked = sorted(rows, key=lambda row: (-_interval(row)[0], -row.trials, row.policy))
    shown = ranked[:MOST_ROWS]
    own = await _own(connection, shown, sees_only)
    on = None if shown_physics is None else _physics(shown_physics)
    return Board(on, len(rows), tuple(_row(place, row, own) for place, row in enumerate(shown, start=1)))


def _interval(row: AnyRow) -> tuple[float, float]:
    return (rate_sequence if row.judged else wilson)(row.successes, row.trials, LEVEL)


def _physics(row: AnyRow) -> BoardPhysics:
    return BoardPhysics(number=row.number, name=row.name, form=row.form, since=row.first_told_at, is_now=row.is_now)


async def _own(connection: AsyncConnection, rows: Sequence[AnyRow], sees_only: str | None) -> dict[str, str] | None:
    """The policies that this owner brought, by digest; None for who may see all."""
    if sees_only is None:
        return None
    wanted = select(policy_owner.c.digest).where(
        policy_owner.c.owner == sees_only, policy_owner.c.digest.in_([row.policy for row in rows])
    )
    return dict.fromkeys((await connection.execute(wanted)).scalars(), sees_only)


def _row(rank: int, row: AnyRow, own: dict[str, str] | None) -> BoardRow:
    owner = row.owner if own is None else own.get(row.policy)
    return BoardRow(
        rank=rank,
        policy=row.policy,
        policy_name=None if owner is None else row.name,
        owner=owner,
        jobs=row.jobs,
        trials=row.trials,
        successes=row.successes,
        success_rate=row.successes / row.trials,
        interval_80=_interval(row),
        intervals="sequence" if row.judged else "wilson",
        last_at=row.last,
    )
