"""Whose policies are whose: who has sent one owns it, sees it and may ask for trials of it; and how much one may keep."""

from collections.abc import Sequence

from sqlalchemy import exists, func, insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow
from services.database.tables import policy, policy_owner, token
from services.errors import Forbidden

_COLUMNS = [column for column in policy.c if column.name != "created_at"]
_OWNED = policy.join(policy_owner, policy_owner.c.digest == policy.c.digest)


async def hold(tx: AsyncConnection, owner: str) -> None:
    """Lets no other transaction that holds the same owner go on before this one ends: what it counts stays true.

    The owner's tokens are what is locked, because nobody asks without one. SQLite has one writer at a time anyhow.
    """
    await tx.execute(select(token.c.token_id).where(token.c.owner == owner).order_by(token.c.token_id).with_for_update())


async def find(connection: AsyncConnection, digest: str, owner: str | None) -> AnyRow | None:
    """The policy's row; with ``owner`` only if it is his, and dated from when it became his."""
    if owner is None:
        wanted = select(policy).where(policy.c.digest == digest)
    else:
        mine = (policy.c.digest == digest, policy_owner.c.owner == owner)
        wanted = select(*_COLUMNS, policy_owner.c.created_at).select_from(_OWNED).where(*mine)
    return (await connection.execute(wanted)).one_or_none()


async def page(connection: AsyncConnection, before: int | None, count: int, owner: str | None) -> Sequence[AnyRow]:
    """Up to ``count`` rows, newest first, whose ``place`` is below ``before``; with ``owner`` only his."""
    place = policy.c.number if owner is None else policy_owner.c.number
    wanted = select(policy, place.label("place"))
    if owner is not None:
        wanted = select(*_COLUMNS, policy_owner.c.created_at, place.label("place")).select_from(_OWNED)
        wanted = wanted.where(policy_owner.c.owner == owner)
    if before is not None:
        wanted = wanted.where(place < before)
    return (await connection.execute(wanted.order_by(place.desc()).limit(count))).all()


async def own(tx: AsyncConnection, digest: str, owner: str, now_iso: str) -> bool:
    """Makes the policy his; false when it was."""
    if (await tx.execute(select(exists().where(policy_owner.c.digest == digest, policy_owner.c.owner == owner)))).scalar():
        return False
    await tx.execute(insert(policy_owner).values(digest=digest, owner=owner, created_at=now_iso))
    return True


async def check_room(connection: AsyncConnection, owner: str, more_bytes: int, limit_bytes: int | None) -> None:
    """Refuses what would make an owner's policies larger than his share; without a limit, nothing.

    Raises:
        Forbidden: there is no room for ``more_bytes``.
    """
    if limit_bytes is None:
        return
    kept = select(func.coalesce(func.sum(policy.c.weights_bytes), 0)).select_from(_OWNED).where(policy_owner.c.owner == owner)
    stored = int((await connection.execute(kept)).scalar_one())
    if stored + more_bytes > limit_bytes:
        detail = (
            f"The policies of {owner} have {stored} bytes; {more_bytes} more would be over the {limit_bytes} bytes that one user "
            "may keep. Ask for trials of a policy that is here (GET /v1/policies), or ask the farm's operator for a larger share."
        )
        raise Forbidden("policy-bytes-quota", detail, stored_bytes=stored, upload_bytes=more_bytes, limit_bytes=limit_bytes)
