"""Which logs go: those that no report refers to, by age and by size; on both homes."""

from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass

from sqlalchemy import and_, bindparam, or_, select, union
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.trial import AttemptState
from services.database.database import Database
from services.database.tables import attempt, job, policy
from services.files.store import FileStore, Kept

DAY_S = 86_400.0
YOUNG_S = 3600.0
"""Nothing younger goes: its row may still be on the way."""
AT_ONCE = 500

_some = bindparam("some", expanding=True)
# The log of an open attempt may become an outcome's, and an accepted outcome is in the report of its job, or will be: a job that
# failed can be queued again, and goes on with what it has.
_IN_USE = or_(
    attempt.c.state == AttemptState.OPEN,
    and_(attempt.c.state == AttemptState.ACCEPTED, job.c.state != JobState.CANCELLED),
)
_REFERRED_TO = union(
    select(policy.c.weights_sha256).where(policy.c.weights_sha256.in_(_some)),
    select(policy.c.graph_sha256).where(policy.c.graph_sha256.in_(_some)),
    *(
        select(column).join(job, job.c.number == attempt.c.job_number).where(column.in_(_some), _IN_USE)
        for column in (attempt.c.log_sha256, attempt.c.truth_sha256)
    ),
)


@dataclass(frozen=True)
class Rules:
    """How long logs are kept that nothing refers to, and how many bytes of them; None is for ever, and any number."""

    days: float | None
    size: int | None


@dataclass(frozen=True)
class Removed:
    """What went."""

    files: int
    bytes: int


async def tidy(database: Database, files: FileStore, rules: Rules, now_s: float) -> Removed:
    """Removes what the rules let go."""
    if rules.days is None and rules.size is None:
        return Removed(0, 0)
    going = to_remove([each async for each in _unreferred(database, files, now_s)], rules, now_s)
    removed = Removed(0, 0)
    for each in going:
        async with database.read() as connection:
            if await _referred_to(connection, [each.sha256]):
                continue  # somebody has come to need it since
        if not await files.remove_if_unchanged(each):
            continue  # it came again, and its row is still on the way
        removed = Removed(removed.files + 1, removed.bytes + each.size)
    return removed


def to_remove(unreferred: Sequence[Kept], rules: Rules, now_s: float) -> list[Kept]:
    """What goes of the files that nothing refers to: all that are too old, then the oldest until the rest is small enough."""
    oldest_first = sorted(unreferred, key=lambda each: (each.stored_s, each.sha256))
    left = sum(each.size for each in oldest_first)
    going = []
    for each in oldest_first:
        is_old = rules.days is not None and now_s - each.stored_s > rules.days * DAY_S
        if not is_old and (rules.size is None or left <= rules.size):
            break
        going.append(each)
        left -= each.size
    return going


async def _unreferred(database: Database, files: FileStore, now_s: float) -> AsyncIterator[Kept]:
    page: list[Kept] = []
    async for each in files.all():
        if now_s - each.stored_s > YOUNG_S:
            page.append(each)
        if len(page) >= AT_ONCE:
            for found in await _without_references(database, page):
                yield found
            page = []
    for found in await _without_references(database, page):
        yield found


async def _without_references(database: Database, page: Sequence[Kept]) -> list[Kept]:
    if not page:
        return []
    async with database.read() as connection:
        referred_to = await _referred_to(connection, [each.sha256 for each in page])
    return [each for each in page if each.sha256 not in referred_to]


async def _referred_to(connection: AsyncConnection, some: Sequence[str]) -> set[str]:
    return set((await connection.execute(_REFERRED_TO, {"some": some})).scalars())
