"""Which physics the robots have and had, as they tell it: by a number, so that only results of the same are put together."""

from sqlalchemy import and_, bindparam, insert, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.bus import Heartbeat
from api_schemas.physics import NOMINAL
from services.database.rows import AnyRow
from services.database.tables import job, physics
from services.jobs.clock import iso

_latest = physics.alias("latest")
NOW = select(_latest.c.number).order_by(_latest.c.told_s.desc(), _latest.c.number.desc()).limit(1).scalar_subquery()
"""The farm's physics: that of the robot that joined last; null before any told what it has."""
_TOLD = and_(
    physics.c.name == bindparam("told_name"),
    physics.c.digest == bindparam("told_digest"),
    physics.c.form == bindparam("told_form"),
)
_TELL_AGAIN = update(physics).where(_TOLD).values(told_s=bindparam("at_s")).returning(physics.c.number)


async def told(tx: AsyncConnection, beat: Heartbeat, now_s: float) -> int | None:
    """The number of the physics that a robot has just joined with, new or known.

    None where a robot does not tell what is behind the name: only nominal physics has nothing behind it.
    """
    if not beat.physics_digest and beat.physics != NOMINAL:
        return None
    named = {"told_name": beat.physics, "told_digest": beat.physics_digest, "told_form": beat.form, "at_s": now_s}
    if (number := (await tx.execute(_TELL_AGAIN, named)).scalar_one_or_none()) is not None:
        return number
    content = {"name": beat.physics, "digest": beat.physics_digest, "form": beat.form}
    new = insert(physics).values(**content, first_told_at=iso(now_s), told_s=now_s)
    try:
        async with tx.begin_nested():
            return (await tx.execute(new.returning(physics.c.number))).scalar_one()
    except IntegrityError:  # another process of the services heard it too
        return (await tx.execute(_TELL_AGAIN, named)).scalar_one()


async def note(tx: AsyncConnection, now: AnyRow, of_robot: int | None) -> None:
    """A trial of the job was done with this physics: the first says what the job's is, any other after it mixes them."""
    if now.physics_mixed or now.physics == of_robot:
        return
    found = {"physics": of_robot} if now.trials_done == 1 else {"physics_mixed": True}
    await tx.execute(update(job).where(job.c.number == now.number).values(found))
