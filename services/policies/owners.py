"""Whose policies are whose: who has sent one owns it, sees it and may ask for trials of it; and how much one may keep."""

from sqlalchemy import and_, delete, exists, func, insert, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.pages import Asked, Page, read_page
from services.database.rows import AnyRow
from services.database.tables import canary, job, policy, policy_owner, token
from services.errors import Conflict, Forbidden, NotFound

_COLUMNS = [column for column in policy.c if column.name != "created_at"]
_OWNED = policy.join(policy_owner, policy_owner.c.digest == policy.c.digest)


async def hold(tx: AsyncConnection, owner: str) -> None:
    """Lets no other transaction that holds the same owner go on before this one ends: what it counts stays true.

    The owner's tokens are what is locked, because nobody asks without one. SQLite has one writer at a time anyhow.
    """
    await tx.execute(select(token.c.token_id).where(token.c.owner == owner).order_by(token.c.token_id).with_for_update())


async def find(connection: AsyncConnection, digest: str, owner: str | None) -> AnyRow | None:
    """The policy's row; with ``owner`` only if it is theirs, and dated from when it became so."""
    if owner is None:
        wanted = select(policy).where(policy.c.digest == digest)
    else:
        mine = (policy.c.digest == digest, policy_owner.c.owner == owner)
        wanted = select(*_COLUMNS, policy_owner.c.created_at).select_from(_OWNED).where(*mine)
    return (await connection.execute(wanted)).one_or_none()


async def find_for(connection: AsyncConnection, digest: str, owner: str) -> AnyRow | None:
    """The policy's row, whoever owns it; its ``owned_at`` is since when it is the owner's, None if it is not."""
    theirs = and_(policy_owner.c.digest == policy.c.digest, policy_owner.c.owner == owner)
    wanted = select(policy, policy_owner.c.created_at.label("owned_at")).select_from(policy.outerjoin(policy_owner, theirs))
    return (await connection.execute(wanted.where(policy.c.digest == digest))).one_or_none()


async def page(connection: AsyncConnection, owner: str | None, asked: Asked) -> Page[AnyRow]:
    """Rows of policies, newest first; with ``owner`` theirs alone, by when they became theirs."""
    if owner is None:
        return await read_page(connection, select(policy), policy.c.number, asked)
    theirs = select(*_COLUMNS, policy_owner.c.created_at).select_from(_OWNED).where(policy_owner.c.owner == owner)
    return await read_page(connection, theirs, policy_owner.c.number, asked)


async def own(tx: AsyncConnection, digest: str, owner: str, now_iso: str) -> str | None:
    """Makes the policy the owner's; gives since when it already was, None if it was not."""
    theirs = (policy_owner.c.digest == digest, policy_owner.c.owner == owner)
    since = (await tx.execute(select(policy_owner.c.created_at).where(*theirs))).scalar_one_or_none()
    if since is None:
        await tx.execute(insert(policy_owner).values(digest=digest, owner=owner, created_at=now_iso))
    return since


async def disown(tx: AsyncConnection, digest: str, owner: str) -> None:
    """The policy is the owner's no more; when it is nobody's, the farm forgets it.

    What a job refers to stays, so that its report means something.

    Raises:
        NotFound: it is not theirs.
        Conflict: a job of it, or the canary, needs it.
    """
    theirs = (policy_owner.c.digest == digest, policy_owner.c.owner == owner)
    if (await tx.execute(delete(policy_owner).where(*theirs))).rowcount == 0:
        raise NotFound("policy-not-found", f"{owner} has no policy with the digest {digest}; GET /v1/policies lists theirs.")
    jobs = select(func.count(), func.max(job.c.number)).where(job.c.policy == digest, job.c.owner == owner)
    count, newest = (await tx.execute(jobs)).one()
    if count:
        job_id = (await tx.execute(select(job.c.job_id).where(job.c.number == newest))).scalar_one()
        its = f"job {job_id}" if count == 1 else f"{count} jobs, the newest of them {job_id}"
        detail = f"The policy {digest} is that of {its}; what a job refers to is kept."
        raise Conflict("policy-in-use", detail, jobs=count, newest_job=job_id)
    if (await tx.execute(select(exists().where(policy_owner.c.digest == digest)))).scalar():
        return
    needed = or_(exists().where(job.c.policy == digest), exists().where(canary.c.policy == digest))
    if (await tx.execute(select(needed))).scalar():
        raise Conflict("policy-in-use", f"A job of somebody else's, or the farm's canary, needs the policy {digest}; it is kept.")
    await tx.execute(delete(policy).where(policy.c.digest == digest))


async def check_room(connection: AsyncConnection, owner: str, more_bytes: int, limit_bytes: int | None) -> None:
    """Refuses what would make an owner's policies, weights and graphs, larger than their share; without a limit, nothing.

    Raises:
        Forbidden: there is no room for ``more_bytes``.
    """
    if limit_bytes is None:
        return
    both = func.coalesce(func.sum(policy.c.weights_bytes + policy.c.graph_bytes), 0)
    kept = select(both).select_from(_OWNED).where(policy_owner.c.owner == owner)
    stored = int((await connection.execute(kept)).scalar_one())
    if stored + more_bytes > limit_bytes:
        detail = (
            f"The policies of {owner} have {stored} bytes, their weights and the graphs that robots run of them; {more_bytes} "
            f"more would be over the {limit_bytes} bytes that a user may keep. Delete one that no job refers to, ask for trials "
            "of one that is here (GET /v1/policies), or ask the farm's operator for a larger share."
        )
        raise Forbidden("policy-bytes-quota", detail, stored_bytes=stored, upload_bytes=more_bytes, limit_bytes=limit_bytes)
