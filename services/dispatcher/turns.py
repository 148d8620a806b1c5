"""Users take turns: whose trial is next for a robot, and who has as many trials running as he may.

The users that have something queued are found by stepping through an index from one name to the next, so that the cost
follows the number of these users and not that of their trials.
"""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, bindparam, func, insert, literal, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import TrialState
from services.database.tables import trial, turn
from services.jobs.lease import ACTIVE


def _next_user(chosen: ColumnElement[bool]) -> Select[Any]:
    """Of the users with a queued trial that is ``chosen`` the one who was served longest ago; one never served comes first."""
    waits = and_(trial.c.state == TrialState.QUEUED, chosen)
    users = select(select(func.min(trial.c.owner)).where(waits).scalar_subquery().label("owner")).cte("users", recursive=True)
    following = select(func.min(trial.c.owner)).where(waits, trial.c.owner > users.c.owner).scalar_subquery()
    users = users.union_all(select(following).where(users.c.owner.is_not(None)))
    served_s = func.coalesce(turn.c.served_s, literal(-1.0))
    may = and_(users.c.owner.is_not(None), users.c.owner.not_in(bindparam("at_limit", expanding=True)))
    found = select(users.c.owner).outerjoin(turn, turn.c.owner == users.c.owner).where(may)
    return found.order_by(served_s, users.c.owner).limit(1)


_DRAWN = _next_user(trial.c.first_choice == bindparam("chosen"))
_UNDRAWN = _next_user(trial.c.first_choice.is_(None))
_RUNNING = select(trial.c.owner).where(trial.c.state.in_(ACTIVE)).group_by(trial.c.owner)
_AT_LIMIT = _RUNNING.having(func.count() >= bindparam("limit"))
_SERVED = update(turn).where(turn.c.owner == bindparam("of_owner")).values(served_s=bindparam("at_s"))


async def whose(connection: AsyncConnection, robot: str | None, limit: int | None) -> str | None:
    """The user whose turn it is, of those with a trial drawn for the robot, or with trials that are not drawn (None)."""
    given = {"at_limit": await at_limit(connection, limit)}
    found = _UNDRAWN if robot is None else _DRAWN
    return (await connection.execute(found, given if robot is None else given | {"chosen": robot})).scalar_one_or_none()


async def at_limit(connection: AsyncConnection, limit: int | None) -> Sequence[str]:
    """The users that have ``limit`` trials running, or more; nobody where there is no limit."""
    return () if limit is None else (await connection.execute(_AT_LIMIT, {"limit": limit})).scalars().all()


async def served(tx: AsyncConnection, owner: str, now_s: float) -> None:
    """A trial of the user was leased: now the others come first."""
    if (await tx.execute(_SERVED, {"of_owner": owner, "at_s": now_s})).rowcount == 0:
        await tx.execute(insert(turn).values(owner=owner, served_s=now_s))
