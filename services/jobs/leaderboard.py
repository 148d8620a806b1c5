"""What policies achieved at a task over all of their jobs whose seed nobody could choose."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import case, distinct, func, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState, TaskName
from api_schemas.leaderboard import BoardPhysics, BoardRow, Contest
from api_schemas.physics import ObjectName
from api_schemas.success_rate import SHOWN_LEVEL
from services.database.rows import AnyRow
from services.database.tables import job, physics, policy_owner, rung
from services.errors import NotFound
from services.jobs.physics import NOW
from services.jobs.standings import MOST_COMPARED, Entry, Tried, entries, letters_of

_RECIPE_OWNER = case((job.c.recipe.is_not(None), job.c.owner)).label("recipe_owner")
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

    They are ordered by the lower bound of Wilson's 95 % interval, so that luck in a few trials does not lead; by that of the
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
    by = (job.c.policy, job.c.recipe, _RECIPE_OWNER)
    rows = (await connection.execute(select(*by, *sums, judged, *names).where(*COUNTED, *of_task).group_by(*by))).all()
    ranked = sorted(entries(rows), key=lambda each: (-each.interval(SHOWN_LEVEL)[0], -each.trials, each.rows[0].policy))
    letters = letters_of(ranked, await _tried(connection, ranked[:MOST_COMPARED], of_task))
    shown = ranked[:MOST_ROWS]
    own = await _own(connection, [row for each in shown for row in each.rows], sees_only)
    on = None if shown_physics is None else _physics(shown_physics)
    numbered = enumerate(zip(shown, letters, strict=False), start=1)
    return Board(on, len({row.policy for row in rows}), tuple(_row(place, *each, own, sees_only) for place, each in numbered))


async def _tried(connection: AsyncConnection, compared: Sequence[Entry], of_task: Sequence[Any]) -> dict[str, Tried]:
    """How the trials of these entries' policies ended that count for the policy itself, from jobs that are over."""
    policies = {each.rows[0].policy for each in compared if each.recipe is None}
    grouped = {row.policy for each in compared if each.recipe is not None for row in each.rows}
    if len(policies) < 2:
        return {}
    columns = (job.c.policy, job.c.seed, job.c.outcomes, job.c.recipe)
    wanted = select(*columns).where(*COUNTED, *of_task, job.c.policy.in_(policies), job.c.outcomes.is_not(None))
    found: dict[str, Tried] = {}
    for row in await connection.execute(wanted.order_by(job.c.ended_at, job.c.number)):
        if row.recipe is None or row.policy not in grouped:
            found.setdefault(row.policy, Tried()).add(row.seed, row.outcomes)
    return found


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


def _row(rank: int, entry: Entry, letters: str | None, own: dict[str, str] | None, sees_only: str | None) -> BoardRow:
    row = entry.rows[0]
    if entry.recipe is None:
        owner = row.owner if own is None else own.get(row.policy)
        name, policy = row.name, row.policy
    else:  # a recipe is its owner's word, whoever else has brought the same policies
        owner = row.recipe_owner if sees_only in (None, row.recipe_owner) else None
        name, policy = None, None
    return BoardRow(
        rank=rank,
        policy=policy,
        policy_name=None if owner is None else name,
        owner=owner,
        jobs=sum(each.jobs for each in entry.rows),
        trials=entry.trials,
        successes=entry.successes,
        success_rate=entry.rate,
        interval_80=entry.interval(0.80),
        interval_95=entry.interval(SHOWN_LEVEL),
        intervals=_kind(entry),
        recipe=None if owner is None else entry.recipe,
        training_seeds=None if entry.recipe is None else len(entry.rows),
        letters=letters,
        last_at=max(each.last for each in entry.rows),
    )


def _kind(entry: Entry) -> Literal["wilson", "sequence", "seeds"]:
    if entry.recipe is not None:
        return "seeds"
    return "sequence" if entry.judged else "wilson"
