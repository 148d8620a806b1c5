"""Calls the webhooks of jobs that have ended; each a few times at most, and by one process of the services at a time.

Owners share the calls: of one no more than a few are made at once, so that one owner's slow receivers delay nobody else's.
"""

import asyncio
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import structlog
from sqlalchemy import func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import FINAL_JOB_STATES
from api_schemas.webhook import SIGNATURE_HEADER, TIMESTAMP_HEADER, Webhook, WebhookCall, signed_bytes
from services.database.database import AWAY, Database
from services.database.rows import AnyRow
from services.database.tables import job, webhook
from services.errors import Conflict, NotFound, TooMany
from services.jobs import views
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.policies import owners
from services.signing import FarmKey
from services.webhooks.calling import FailedError, Reach, RefusedError, call

log = structlog.get_logger()
AGAIN_AFTER_S = (10.0, 60.0, 600.0, 3600.0)
"""Pauses between the tries of a call; after the last there is no other."""
HELD_S = 60.0
"""A call that is under way is due again after so long, should its process have ended meanwhile."""
AT_ONCE = 8
AT_ONCE_OF_OWNER = 2
MOST_OPEN = 100
"""Webhooks of one owner that still have a call before them."""
LOOK_AGAIN_S = 30
LOOK_EVERY_S = 1.0


async def register(tx: AsyncConnection, job_id: str, url: str) -> None:
    """Notes that the address is called when the job has ended.

    Raises:
        TooMany: the job's owner has reached the limit of open webhooks.
    """
    row = (await tx.execute(select(job.c.number, job.c.owner).where(job.c.job_id == job_id))).one()
    await owners.hold(tx, row.owner)
    known = select(func.count()).select_from(webhook).join(job, job.c.number == webhook.c.job_number)
    count = (await tx.execute(known.where(job.c.owner == row.owner, webhook.c.due_s.is_not(None)))).scalar_one()
    if count >= MOST_OPEN:
        detail = (
            f"{row.owner} has {count} webhooks that are still to be called and may have {MOST_OPEN}. Wait until a job with one "
            "has ended and its address has answered, or send this job without a webhook."
        )
        raise TooMany("open-webhooks-quota", detail, LOOK_AGAIN_S, open_webhooks=count, limit=MOST_OPEN)
    await tx.execute(insert(webhook).values(job_number=row.number, url=url, tries=0, due_s=0.0))


async def add(tx: AsyncConnection, row: AnyRow, url: str) -> None:
    """Notes an address for a job that is there already.

    Raises:
        Conflict: the job is over, or has one.
        TooMany: as ``register``.
    """
    if row.state in FINAL_JOB_STATES:
        raise Conflict("job-ended", f"Job {row.job_id} has {row.state}: nothing more is told of it.", state=row.state)
    if (await tx.execute(select(webhook.c.url).where(webhook.c.job_number == row.number))).first() is not None:
        raise Conflict("webhook-set", f"Job {row.job_id} has its webhook already; a job has one.")
    await register(tx, row.job_id, url)


async def show(connection: AsyncConnection, row: AnyRow) -> Webhook:
    """The webhook of a job.

    Raises:
        NotFound: it has none.
    """
    found = await known(connection, row)
    if found is None:
        raise NotFound("webhook-not-found", f"Job {row.job_id} has no webhook; one is named when a job is sent, or later.")
    return found


async def known(connection: AsyncConnection, row: AnyRow) -> Webhook | None:
    """The webhook of a job; None if it has none."""
    found = (await connection.execute(select(webhook).where(webhook.c.job_number == row.number))).one_or_none()
    if found is None:
        return None
    return Webhook(job_id=row.job_id, url=found.url, tries=found.tries, is_open=found.due_s is not None, said=found.said)


@dataclass(frozen=True)
class Deliverer:
    """Looks for calls that are due, and has them made; owns those that are under way, with whose they are."""

    farm: str
    database: Database
    clock: FarmClock
    fleet: Fleet
    key: FarmKey
    reach: Reach = field(default_factory=Reach)
    _under_way: dict[asyncio.Task[None], str] = field(default_factory=dict)

    async def deliver(self) -> int:
        """Begins the calls that are due now and waits for none; gives how many."""
        now_s, begun = self.clock.now_s(), 0
        async with self.database.read() as connection:
            due = await _due(connection, now_s, self._full(), AT_ONCE - len(self._under_way))
        for each in due:
            if each.owner not in self._full() and await self._take(each, now_s):
                task = asyncio.create_task(self._call(each))
                self._under_way[task] = each.owner
                task.add_done_callback(self._under_way.pop)
                begun += 1
        return begun

    async def end(self, within_s: float = 0.0) -> None:
        """Waits so long for the calls that are under way, and breaks the others off; they are due again later."""
        if under_way := set(self._under_way):
            await asyncio.wait(under_way, timeout=within_s)
            for task in under_way:
                task.cancel()
            await asyncio.wait(under_way)

    def _full(self) -> set[str]:
        """The owners of whom as many calls are under way as may be."""
        return {owner for owner, count in Counter(self._under_way.values()).items() if count >= AT_ONCE_OF_OWNER}

    async def _take(self, due: AnyRow, now_s: float) -> bool:
        """Holds a call, if no other process has taken it."""
        held = update(webhook).where(
            webhook.c.job_number == due.number, webhook.c.tries == due.tries, webhook.c.due_s == due.due_s
        )
        async with self.database.write() as tx:
            return (await tx.execute(held.values(tries=due.tries + 1, due_s=now_s + HELD_S))).rowcount == 1

    async def _call(self, due: AnyRow) -> None:
        """Makes a call that was taken and notes what came of it; what goes wrong with it concerns no other."""
        tries = due.tries + 1
        try:
            again_s, said = await self._tried(due)
            log.info("webhook", job=due.job_id, tries=tries, said=said)
            due_s = None if again_s is None else self.clock.now_s() + again_s
            done = update(webhook).where(webhook.c.job_number == due.number, webhook.c.tries == tries)
            async with self.database.write() as tx:
                await tx.execute(done.values(due_s=due_s, said=said))
        except AWAY:  # nothing can be noted now; the call is due again when it is not held any more
            log.warning("webhook not noted", job=due.job_id, tries=tries, exc_info=True)

    async def _tried(self, due: AnyRow) -> tuple[float | None, str]:
        """One try; gives after how many seconds another follows, None for never, and what is said of this one."""
        tries = due.tries + 1
        if due.tries > len(AGAIN_AFTER_S):
            return None, f"given up after {due.tries} tries: the farm stopped during the last"
        try:
            body, timestamp = await self._body(due), str(int(self.clock.now_s()))
            headers = {TIMESTAMP_HEADER: timestamp, SIGNATURE_HEADER: self.key.sign(signed_bytes(timestamp, body))}
            return None, f"delivered: answered {await call(due.url, headers, body, self.reach)}"
        except RefusedError as error:
            return None, f"given up: {error}"
        except FailedError as error:
            log.info("webhook failed", job=due.job_id, tries=tries, why=error.why)
            if tries > len(AGAIN_AFTER_S):
                return None, f"given up after {tries} tries: {error}"
            return AGAIN_AFTER_S[tries - 1], f"try {tries} failed: {error}"
        except AWAY:
            raise
        except Exception:
            log.exception("webhook", job=due.job_id, tries=tries)
            return None, "given up: the farm could not make this call; its operator finds the reason in the log"

    async def _body(self, due: AnyRow) -> bytes:
        async with self.database.read() as connection:
            row = await views.job_row(connection, due.job_id, None)
            (shown,) = await views.show_jobs(connection, [row], self.fleet, self.clock.now_s())
        return WebhookCall(farm=self.farm, job=shown).model_dump_json().encode()


async def _due(connection: AsyncConnection, now_s: float, full: Collection[str], most: int) -> Sequence[AnyRow]:
    """Calls of jobs that have ended, those first that have waited longest, of each owner but those named a few."""
    place = func.row_number().over(partition_by=job.c.owner, order_by=(webhook.c.due_s, job.c.number))
    ended = (
        select(webhook.c.url, webhook.c.tries, webhook.c.due_s, job.c.number, job.c.job_id, job.c.owner, place.label("place"))
        .join(job, job.c.number == webhook.c.job_number)
        .where(webhook.c.due_s <= now_s, job.c.state.in_(FINAL_JOB_STATES), job.c.owner.not_in(full))
        .subquery()
    )
    wanted = select(ended).where(ended.c.place <= AT_ONCE_OF_OWNER).order_by(ended.c.due_s, ended.c.number).limit(most)
    return (await connection.execute(wanted)).all()
