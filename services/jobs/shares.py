"""Shares: who may see one report or one trial without a token, kept as hashes of what their links end with."""

import hashlib
import secrets
from dataclasses import dataclass

from sqlalchemy import func, insert, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.share import Share
from services.database.pages import Asked, Page, read_page
from services.database.rows import AnyRow
from services.database.tables import job, share
from services.errors import NotFound, TooMany
from services.jobs.clock import iso
from services.jobs.submission import new_id
from services.policies import owners

SECRET_BYTES = 24
"""192 random bits: nobody finds a link by trying."""
MOST_OPEN = 200
"""Of one owner."""
LOOK_AGAIN_S = 60
DAY_S = 86_400.0
_WITH_JOB = select(share, job.c.job_id, job.c.owner.label("job_owner")).join(job, job.c.number == share.c.job_number)


@dataclass(frozen=True)
class Wish:
    """What is to be shared for how long; ``trial_id`` None is the job's report, ``token_id`` the token of who shares it."""

    job_number: int
    trial_id: str | None
    at_s: float | None
    days: float
    owner: str
    token_id: str


async def make(tx: AsyncConnection, now_s: float, wish: Wish) -> tuple[AnyRow, str]:
    """Shares it; gives the row and what its link ends with, which is kept nowhere.

    Raises:
        TooMany: the owner has reached the limit of open shares.
    """
    await owners.hold(tx, wish.owner)
    still = select(func.count()).select_from(share)
    still = still.where(share.c.owner == wish.owner, share.c.revoked_at.is_(None), share.c.expires_s > now_s)
    count = (await tx.execute(still)).scalar_one()
    if count >= MOST_OPEN:
        detail = f"{wish.owner} has {count} open shares and may have {MOST_OPEN}; revoke some, GET /v1/shares lists them."
        raise TooMany("open-shares-quota", detail, LOOK_AGAIN_S, open_shares=count, limit=MOST_OPEN)
    share_id, secret = new_id("s"), secrets.token_urlsafe(SECRET_BYTES)
    row = insert(share).values(
        share_id=share_id,
        secret_sha256=_hash(secret),
        job_number=wish.job_number,
        trial_id=wish.trial_id,
        at_s=wish.at_s,
        owner=wish.owner,
        token_id=wish.token_id,
        created_at=iso(now_s),
        expires_s=now_s + wish.days * DAY_S,
    )
    await tx.execute(row)
    return (await tx.execute(_WITH_JOB.where(share.c.share_id == share_id))).one(), secret


async def opened(connection: AsyncConnection, secret: str, now_s: float) -> AnyRow:
    """The row of an open share; looked up each time, so that a revoked one leads nowhere from then on.

    Raises:
        NotFound: there never was one with this link, or it was revoked, or its time is over.
    """
    found = (await connection.execute(_WITH_JOB.where(share.c.secret_sha256 == _hash(secret)))).one_or_none()
    if found is None or not is_open(found, now_s):
        raise missing()
    return found


def missing() -> NotFound:
    """What is said of every link that leads nowhere, whatever the reason."""
    return NotFound("share-not-found", "This link leads nowhere: it was mistyped, revoked, or is over. Ask who gave it to you.")


async def page(connection: AsyncConnection, owner: str | None, asked: Asked) -> Page[AnyRow]:
    """Shares, newest first: those that an owner made, and those of their jobs; None for all."""
    wanted = _WITH_JOB if owner is None else _WITH_JOB.where(or_(share.c.owner == owner, job.c.owner == owner))
    return await read_page(connection, wanted, share.c.number, asked)


async def revoke(tx: AsyncConnection, now_s: float, share_id: str, owner: str | None) -> None:
    """Ends a share at once; again changes nothing.

    Raises:
        NotFound: there is none of this id that the owner made, or that is of a job of theirs.
    """
    found = (await tx.execute(_WITH_JOB.where(share.c.share_id == share_id))).one_or_none()
    if found is None or owner not in (None, found.owner, found.job_owner):
        raise NotFound("share-not-found", f"There is no share {share_id} of yours; GET /v1/shares lists them.")
    ended = update(share).where(share.c.share_id == share_id, share.c.revoked_at.is_(None))
    await tx.execute(ended.values(revoked_at=iso(now_s)))


def is_open(row: AnyRow, now_s: float) -> bool:
    """Whether its link leads somewhere, as far as its row says; its maker's token may have ended."""
    return row.revoked_at is None and now_s < row.expires_s


def show(row: AnyRow, now_s: float) -> Share:
    """A share as its maker sees it."""
    return Share(
        share_id=row.share_id,
        job_id=row.job_id,
        trial_id=row.trial_id,
        at_s=row.at_s,
        owner=row.owner,
        created_at=row.created_at,
        expires_at=iso(row.expires_s),
        revoked_at=row.revoked_at,
        is_open=is_open(row, now_s),
    )


def _hash(secret: str) -> str:
    """A plain hash is enough: the secret is random."""
    return hashlib.sha256(secret.encode()).hexdigest()
