"""The queue of trials, as the dispatcher reads it: every query of the dispatcher is here."""

import json
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

from sqlalchemy import (
    FromClause,
    Integer,
    Select,
    String,
    and_,
    bindparam,
    func,
    select,
    text,
    update,
)
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import AttemptState, TrialState
from services.database.rows import AnyRow
from services.database.tables import PINNED, UNDRAWN, attempt, job, policy, trial
from services.dispatcher.choice import Choice, choose
from services.jobs.lease import ACTIVE
from services.jobs.locking import lock_job
from services.jobs.order import drawn_order

Why = Callable[[str], str]
PASSED_OVER_AT_ONCE = 100
"""How many of the oldest trials that wait for busy robots are looked at when another robot has nothing of its own."""


def _with_job(trials: FromClause) -> Select[Any]:
    """Trials with what the dispatcher wants to know of their jobs, oldest first."""
    renamed = (job.c.seed.label("job_seed"), job.c.state.label("job_state"), job.c.robot.label("pinned_robot"))
    columns = (job.c.job_id, job.c.task, job.c.policy, job.c.any_robot, job.c.object, job.c.object_scale, job.c.images)
    joined = select(trials, *columns, *renamed).join(job, job.c.number == trials.c.job_number)
    return joined.order_by(trials.c.job_number, trials.c.ordinal)


def _oldest_of() -> Select[Any]:
    """The oldest of a user's trials for a robot; it is found before its job is, or a database may begin with all jobs."""
    chosen = (
        trial.c.state == TrialState.QUEUED,
        trial.c.first_choice == bindparam("chosen"),
        trial.c.owner == _OF_OWNER,
        _OF_RANK,
    )
    return _with_job(select(trial).where(*chosen).order_by(trial.c.job_number, trial.c.ordinal).limit(1).subquery())


def _oldest_undrawn() -> Select[Any]:
    """The oldest of a user's trials that have no order yet.

    The user and all that follow in the alphabet, cut off, and this one alone: so a database has no other way to that order
    than the index of such trials, and does not look for them among all that are done.
    """
    seed = select(job.c.seed).where(job.c.number == trial.c.job_number).scalar_subquery().label("job_seed")
    from_him = select(trial, seed).where(text(UNDRAWN), _OF_RANK, trial.c.owner >= _OF_OWNER)
    few = from_him.order_by(trial.c.owner, trial.c.job_number, trial.c.ordinal).limit(bindparam("most", type_=Integer)).subquery()
    return select(few).where(few.c.owner == _OF_OWNER).order_by(few.c.job_number, few.c.ordinal)


def _drawn() -> Select[Any]:
    """The first choices of queued trials, stepping through an index from one to the next."""
    queued = trial.c.state == TrialState.QUEUED
    first = select(func.min(trial.c.first_choice)).where(queued).scalar_subquery().label("robot")
    robots = select(first).cte("drawn_robots", recursive=True)
    following = select(func.min(trial.c.first_choice)).where(queued, trial.c.first_choice > robots.c.robot).scalar_subquery()
    robots = robots.union_all(select(following).where(robots.c.robot.is_not(None)))
    return select(robots.c.robot).where(robots.c.robot.is_not(None))


_OF_OWNER = bindparam("of_owner", type_=String)
_OF_RANK = trial.c.priority == bindparam("rank", type_=Integer)
_DRAWN = _drawn()
_QUEUED = _with_job(trial).where(trial.c.state == TrialState.QUEUED)
_ANY = select(trial.c.trial_id).where(trial.c.state == TrialState.QUEUED).limit(1)
_OLDEST_OF = _oldest_of()
_OLDEST_UNDRAWN = _oldest_undrawn()
_BUSY = and_(
    trial.c.first_choice.in_(bindparam("busy", expanding=True)),
    job.c.robot.is_(None),
    trial.c.owner.not_in(bindparam("at_limit", expanding=True)),
)
_WAITING = (
    select(trial.c.trial_id)
    .join(job, job.c.number == trial.c.job_number)
    .where(trial.c.state == TrialState.QUEUED, _BUSY)
    .order_by(trial.c.priority, trial.c.job_number, trial.c.ordinal)
    .limit(PASSED_OVER_AT_ONCE)
    # Who is moving a trial now need not be waited for: the mark can be made the next time.
    .with_for_update(of=trial, skip_locked=True)
)
_PASS_OVER = (
    update(trial)
    .where(trial.c.trial_id.in_(bindparam("waiting", expanding=True)), trial.c.passed_over_s.is_(None))
    .values(passed_over_s=bindparam("since_s"))
)
_PASSED_OVER = (
    _QUEUED.where(_BUSY, trial.c.passed_over_s <= bindparam("until_s"))
    .order_by(None)
    .order_by(trial.c.priority, trial.c.job_number, trial.c.ordinal)
    .limit(PASSED_OVER_AT_ONCE)
)
_POINT = (
    update(trial)
    .where(trial.c.trial_id == bindparam("of_trial"), trial.c.state == TrialState.QUEUED)
    .values(
        robot_order=bindparam("to_order"),
        first_choice=bindparam("to_choice"),
        departure=bindparam("to_departure"),
        passed_over_s=None,
    )
)


async def anything_queued(connection: AsyncConnection) -> bool:
    """Whether any trial waits for a robot."""
    return (await connection.execute(_ANY)).first() is not None


async def oldest_of(connection: AsyncConnection, robot: str, rank: int, owner: str) -> AnyRow | None:
    """The user's oldest queued trial of this priority whose first choice is the robot."""
    return (await connection.execute(_OLDEST_OF, {"chosen": robot, "rank": rank, "of_owner": owner})).first()


async def draw(tx: AsyncConnection, rank: int, owner: str, known: Sequence[str], healthy: Collection[str], why: Why) -> set[str]:
    """Draws the orders of the user's next trials of this priority that have none, one for each known robot.

    Gives the robots that they are for.
    """
    rows = (await tx.execute(_OLDEST_UNDRAWN, {"rank": rank, "of_owner": owner, "most": max(1, len(known))})).all()
    for number in sorted({row.job_number for row in rows}):
        await lock_job(tx, number)
    choices = []
    for row in rows:
        order = json.loads(row.robot_order) or drawn_order(row.job_seed, row.ordinal, known)
        choices.append(_pointing(row, choose(order, healthy, await _faulted(tx, row), why)))
    if choices:
        await tx.execute(_POINT, choices)
    return {choice["to_choice"] for choice in choices} - {None}


async def choose_again(tx: AsyncConnection, row: AnyRow, healthy: Collection[str], why: Why) -> Choice:
    """Points a drawn trial to the robot that is now the first of its order; one that is pinned to a robot stays with it."""
    if row.pinned_robot is not None:
        choice = Choice((row.pinned_robot,), row.pinned_robot, None)
    else:
        choice = choose(json.loads(row.robot_order), healthy, await _faulted(tx, row), why)
    if choice.first_choice is not None and choice.first_choice != row.first_choice:
        await lock_job(tx, row.job_number)
        await tx.execute(_POINT, _pointing(row, choice))
    return choice


async def drawn_robots(connection: AsyncConnection) -> set[str]:
    """The first choices of all queued trials that are drawn."""
    return set((await connection.execute(_DRAWN)).scalars())


async def drawn_for(connection: AsyncConnection, robots: Iterable[str]) -> Sequence[AnyRow]:
    """The queued trials whose first choice is one of the robots and that may go to another."""
    wanted = _QUEUED.where(trial.c.first_choice.in_(list(robots)), job.c.robot.is_(None))
    return (await connection.execute(wanted)).all()


async def pass_over(tx: AsyncConnection, busy: Collection[str], now_s: float, at_limit: Sequence[str]) -> None:
    """Notes that another robot is idle while the oldest trials that were drawn for busy robots wait for these.

    In a transaction of its own: it takes trials without their jobs, and must wait for nobody while it has them.
    """
    # Two statements: as a part of the other one, the first may run more than once and find more than its limit.
    waiting = (await tx.execute(_WAITING, {"busy": list(busy), "at_limit": at_limit})).scalars().all()
    await tx.execute(_PASS_OVER, {"waiting": waiting, "since_s": now_s})


async def passed_over(
    connection: AsyncConnection, busy: Collection[str], until_s: float, at_limit: Sequence[str]
) -> Sequence[AnyRow]:
    """The oldest trials that were drawn for busy robots and have been passed over since ``until_s`` or before."""
    return (await connection.execute(_PASSED_OVER, {"busy": list(busy), "until_s": until_s, "at_limit": at_limit})).all()


async def next_of(connection: AsyncConnection, row: AnyRow, robots: Collection[str], why: Why) -> str | None:
    """Which of the robots comes first in the trial's order."""
    return choose(json.loads(row.robot_order), robots, await _faulted(connection, row), why).first_choice


async def active(connection: AsyncConnection) -> Sequence[AnyRow]:
    """All leased and running trials, with what their jobs want."""
    columns = (trial.c.trial_id, trial.c.fence, trial.c.robot, trial.c.lease_until_s, trial.c.state.label("trial_state"))
    columns = (*columns, job.c.job_id, job.c.cancel_requested, job.c.state)
    wanted = select(*columns).join(job, job.c.number == trial.c.job_number).where(trial.c.state.in_(ACTIVE))
    return (await connection.execute(wanted)).all()


async def pinned(connection: AsyncConnection) -> Sequence[AnyRow]:
    """All jobs that wait for the one robot that may run their trials."""
    columns = (job.c.number, job.c.job_id, job.c.robot, job.c.trials, job.c.trials_done, job.c.created_s)
    waits = (
        text(PINNED),
        job.c.trials_active == 0,
        job.c.cancel_requested.is_(False),
    )
    return (await connection.execute(select(*columns).where(*waits))).all()


async def policy_of(connection: AsyncConnection, digest: str) -> AnyRow:
    """The manifest and the graph of a policy."""
    return (await connection.execute(select(policy.c.manifest, policy.c.graph_sha256).where(policy.c.digest == digest))).one()


async def _faulted(connection: AsyncConnection, row: AnyRow) -> frozenset[str]:
    if row.fence == 0:
        return frozenset()
    not_again = (AttemptState.PLATFORM_FAULT, AttemptState.DECLINED)
    failed = select(attempt.c.robot).where(attempt.c.trial_id == row.trial_id, attempt.c.state.in_(not_again))
    return frozenset((await connection.execute(failed)).scalars())


def _pointing(row: AnyRow, choice: Choice) -> dict[str, Any]:
    return {
        "of_trial": row.trial_id,
        "to_order": json.dumps(choice.order),
        "to_choice": choice.first_choice,
        "to_departure": choice.departure,
    }
