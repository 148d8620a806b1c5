"""Users take turns within a priority: whose trial is next for a robot, and who has reached the limit of running trials.

The users that have something queued are found by stepping through an index from one name to the next, so that the cost
follows the number of these users and not that of their trials.
"""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Integer, Select, TextClause, and_, bindparam, func, literal, or_, select, text, union_all
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.database.tables import UNDRAWN, trial, turn
from services.jobs.lease import ACTIVE
from services.jobs.priority import RANKS


def _next_user(chosen: ColumnElement[bool] | TextClause, *, users_of: str) -> Select[Any, Any]:
    """Of the users with a trial that is ``chosen`` the one who was served longest ago; one never served comes first."""
    users = select(select(func.min(trial.c.owner)).where(chosen).scalar_subquery().label("owner")).cte(users_of, recursive=True)
    following = select(func.min(trial.c.owner)).where(chosen, trial.c.owner > users.c.owner).scalar_subquery()
    users = users.union_all(select(following).where(users.c.owner.is_not(None)))
    served_s = func.coalesce(turn.c.served_s, literal(-1.0))
    may = and_(users.c.owner.is_not(None), users.c.owner.not_in(bindparam("at_limit", expanding=True)))
    found = select(users.c.owner, served_s.label("served_s")).outerjoin(turn, turn.c.owner == users.c.owner).where(may)
    return found.order_by(served_s, users.c.owner).limit(1)


def _any(chosen: ColumnElement[bool]) -> ColumnElement[bool]:
    """Whether a trial is ``chosen``. It asks for the first in the order of the index: where nothing was said of an order,
    PostgreSQL thinks that it meets one of so many at once, and reads the whole table where there is none.
    """
    first = select(trial.c.owner).where(chosen).order_by(trial.c.owner, trial.c.job_number, trial.c.ordinal).limit(1)
    return first.scalar_subquery().is_not(None)


_OF_RANK = trial.c.priority == bindparam("rank", type_=Integer)
_IS_DRAWN = and_(trial.c.state == TrialState.QUEUED, trial.c.first_choice == bindparam("chosen"), _OF_RANK)
_DRAWN = _next_user(_IS_DRAWN, users_of="users_of_drawn")
_UNDRAWN = _next_user(and_(text(UNDRAWN), _OF_RANK), users_of="users_of_undrawn")
_BOTH = union_all(*(select(literal(of).label("drawn"), *each.subquery().c) for of, each in ((True, _DRAWN), (False, _UNDRAWN))))
_RANKS = select(
    *(
        or_(
            _any(and_(trial.c.state == TrialState.QUEUED, trial.c.first_choice == bindparam("chosen"), trial.c.priority == rank)),
            _any(and_(text(UNDRAWN), trial.c.priority == rank)),
        )
        for rank in sorted(RANKS.values())
    )
)
_RUNNING = select(trial.c.owner).where(trial.c.state.in_(ACTIVE)).group_by(trial.c.owner)
_AT_LIMIT = _RUNNING.having(func.count() >= bindparam("limit"))


async def ranks(connection: AsyncConnection, robot: str) -> Sequence[int]:
    """The priorities of trials that are drawn for the robot or not yet drawn, the most pressing first."""
    found = await connection.execute(_RANKS, {"chosen": robot})
    return [rank for rank, exists in zip(sorted(RANKS.values()), found.one(), strict=True) if exists]


async def next_users(
    connection: AsyncConnection, robot: str, rank: int, at_limit: Sequence[str]
) -> tuple[AnyRow | None, AnyRow | None]:
    """Of the users with a trial of this rank drawn for the robot the one who comes next, and of those with trials that are not
    drawn yet: ``owner`` and ``served_s``.
    """
    found = (await connection.execute(_BOTH, {"chosen": robot, "rank": rank, "at_limit": at_limit})).all()
    of_drawn, of_undrawn = ([row for row in found if bool(row.drawn) == drawn] for drawn in (True, False))
    return of_drawn[0] if of_drawn else None, of_undrawn[0] if of_undrawn else None


async def next_with_undrawn(connection: AsyncConnection, rank: int, at_limit: Sequence[str]) -> AnyRow | None:
    """Of the users with trials of this rank that are not drawn yet the one who comes next: ``owner`` and ``served_s``."""
    return (await connection.execute(_UNDRAWN, {"rank": rank, "at_limit": at_limit})).one_or_none()


async def any_undrawn(connection: AsyncConnection, at_limit: Sequence[str]) -> bool:
    """Whether any user who may have more trials running has one that is not drawn yet."""
    for rank in RANKS.values():
        if await next_with_undrawn(connection, rank, at_limit) is not None:
            return True
    return False


async def at_limit(connection: AsyncConnection, limit: int | None) -> Sequence[str]:
    """The users that have ``limit`` trials running, or more; nobody where there is no limit."""
    return () if limit is None else (await connection.execute(_AT_LIMIT, {"limit": limit})).scalars().all()
