"""What the services processes of one farm tell each other by the database: who has signed out, and who asks how often."""

from collections.abc import Mapping

from sqlalchemy import delete, or_, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.postgres import is_postgres
from services.database.tables import asked, signed_out

KEPT_S = 3600.0
"""Counts that nobody adds to for so long go: no limit looks so far back."""


async def note_signed_out(tx: AsyncConnection, mark: bytes, until_s: float, at_s: float) -> None:
    """Writes down that a session has ended at ``at_s``; ``mark`` is the hash of its cookie, too old at ``until_s`` anyhow."""
    dialect = postgresql if is_postgres(tx) else sqlite
    row = dialect.insert(signed_out).values(mark=mark.hex(), until_s=until_s, at_s=at_s)
    await tx.execute(row.on_conflict_do_nothing())


async def all_signed_out(connection: AsyncConnection, now_s: float, since_s: float | None = None) -> list[tuple[bytes, float]]:
    """Marks of all sessions that have ended, since ``since_s`` if given, and are not too old yet, and until when they are not."""
    wanted = select(signed_out).where(signed_out.c.until_s > now_s)
    if since_s is not None:
        wanted = wanted.where(or_(signed_out.c.at_s >= since_s, signed_out.c.at_s.is_(None)))
    rows = await connection.execute(wanted)
    return [(bytes.fromhex(row.mark), row.until_s) for row in rows]


async def add_asked(tx: AsyncConnection, counts: Mapping[str, int], now_s: float) -> dict[str, int]:
    """Adds how often each asked here; gives how often they have asked anywhere."""
    if not counts:
        return {}
    dialect = postgresql if is_postgres(tx) else sqlite
    new = dialect.insert(asked).values([{"name": name, "times": counts[name], "at_s": now_s} for name in sorted(counts)])
    added = new.on_conflict_do_update(
        index_elements=[asked.c.name], set_={"times": asked.c.times + new.excluded.times, "at_s": new.excluded.at_s}
    ).returning(asked.c.name, asked.c.times)
    return {row.name: row.times for row in await tx.execute(added)}


async def forget_old(tx: AsyncConnection, now_s: float) -> None:
    """Removes what nobody needs any more."""
    await tx.execute(delete(signed_out).where(signed_out.c.until_s <= now_s))
    await tx.execute(delete(asked).where(asked.c.at_s <= now_s - KEPT_S))
