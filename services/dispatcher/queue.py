"""The queue of trials, as the dispatcher reads it: every query of the dispatcher is here."""

import json
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

from sqlalchemy import Integer, Select, bindparam, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import AttemptState, TrialState
from services.database.rows import AnyRow
from services.database.tables import attempt, job, policy, trial
from services.dispatcher.choice import Choice, choose
from services.jobs.lease import ACTIVE
from services.jobs.order import drawn_order

Why = Callable[[str], str]


def _queued() -> Select[Any]:
    columns = (trial, job.c.job_id, job.c.task, job.c.seed.label("job_seed"), job.c.policy, job.c.state.label("job_state"))
    joined = select(*columns).join(job, job.c.number == trial.c.job_number)
    return joined.where(trial.c.state == TrialState.QUEUED).order_by(trial.c.job_number, trial.c.ordinal)


_QUEUED = _queued()
_ANY = select(trial.c.trial_id).where(trial.c.state == TrialState.QUEUED).limit(1)
_OLDEST_OF = _QUEUED.where(trial.c.first_choice == bindparam("chosen")).limit(1)
_OTHERS = _QUEUED.where(trial.c.first_choice > "", trial.c.first_choice != bindparam("chosen")).limit(1)
_UNDRAWN = _QUEUED.where(trial.c.first_choice.is_(None)).limit(bindparam("most", type_=Integer))
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


async def oldest_of(connection: AsyncConnection, robot: str) -> AnyRow | None:
    """The oldest queued trial whose first choice is the robot."""
    return (await connection.execute(_OLDEST_OF, {"chosen": robot})).first()


async def oldest_of_others(connection: AsyncConnection, robot: str) -> AnyRow | None:
    """The oldest queued trial that was drawn for another robot."""
    return (await connection.execute(_OTHERS, {"chosen": robot})).first()


async def draw(tx: AsyncConnection, known: Sequence[str], healthy: Collection[str], why: Why) -> int:
    """Draws the orders of the next trials that have none, one for each known robot; gives how many there were."""
    rows = (await tx.execute(_UNDRAWN, {"most": max(1, len(known))})).all()
    choices = []
    for row in rows:
        order = json.loads(row.robot_order) or drawn_order(row.job_seed, row.ordinal, known)
        choices.append(_pointing(row, choose(order, healthy, await _faulted(tx, row), why)))
    if choices:
        await tx.execute(_POINT, choices)
    return len(rows)


async def choose_again(tx: AsyncConnection, row: AnyRow, healthy: Collection[str], why: Why) -> Choice:
    """Points a drawn trial to the robot that is now the first of its order."""
    choice = choose(json.loads(row.robot_order), healthy, await _faulted(tx, row), why)
    if choice.first_choice is not None and choice.first_choice != row.first_choice:
        await tx.execute(_POINT, _pointing(row, choice))
    return choice


async def drawn_for(connection: AsyncConnection, robots: Iterable[str]) -> Sequence[AnyRow]:
    """The queued trials whose first choice is one of the robots."""
    return (await connection.execute(_QUEUED.where(trial.c.first_choice.in_(list(robots))))).all()


async def pass_over(tx: AsyncConnection, row: AnyRow, now_s: float) -> None:
    """Notes that another robot is idle while the trial waits for its busy first choice."""
    noted = update(trial).where(trial.c.trial_id == row.trial_id, trial.c.passed_over_s.is_(None))
    await tx.execute(noted.values(passed_over_s=now_s))


async def active(connection: AsyncConnection) -> Sequence[AnyRow]:
    """All leased and running trials, with what their jobs want."""
    columns = (trial.c.trial_id, trial.c.fence, trial.c.robot, trial.c.lease_until_s, job.c.cancel_requested, job.c.state)
    wanted = select(*columns).join(job, job.c.number == trial.c.job_number).where(trial.c.state.in_(ACTIVE))
    return (await connection.execute(wanted)).all()


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
