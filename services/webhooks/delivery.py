"""Calls the webhooks of jobs that have ended; each a few times at most, and by one process of the services at a time."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field

import structlog
from sqlalchemy import insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import FINAL_JOB_STATES
from api_schemas.webhook import SIGNATURE_HEADER, TIMESTAMP_HEADER, Webhook, WebhookCall, signed_bytes
from services.database.database import Database
from services.database.rows import AnyRow
from services.database.tables import job, webhook
from services.errors import NotFound
from services.jobs import views
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.signing import FarmKey
from services.webhooks.calling import FailedError, Reach, RefusedError, call

log = structlog.get_logger()
AGAIN_AFTER_S = (10.0, 60.0, 600.0, 3600.0)
"""Pauses between the tries of a call; after the last there is no other."""
HELD_S = 60.0
"""A call that is under way is due again after so long, should its process have ended meanwhile."""
AT_ONCE = 8
LOOK_EVERY_S = 1.0


async def register(tx: AsyncConnection, job_id: str, url: str) -> None:
    """Notes that the address is called when the job has ended."""
    number = select(job.c.number).where(job.c.job_id == job_id).scalar_subquery()
    await tx.execute(insert(webhook).values(job_number=number, url=url, tries=0, due_s=0.0))


async def show(connection: AsyncConnection, row: AnyRow) -> Webhook:
    """The webhook of a job.

    Raises:
        NotFound: it has none.
    """
    found = (await connection.execute(select(webhook).where(webhook.c.job_number == row.number))).one_or_none()
    if found is None:
        raise NotFound("webhook-not-found", f"Job {row.job_id} has no webhook; one is named when a job is sent.")
    return Webhook(job_id=row.job_id, url=found.url, tries=found.tries, is_open=found.due_s is not None, said=found.said)


@dataclass(frozen=True)
class Deliverer:
    """Looks for calls that are due, and makes them."""

    farm: str
    database: Database
    clock: FarmClock
    fleet: Fleet
    key: FarmKey
    reach: Reach = field(default_factory=Reach)

    async def deliver(self) -> int:
        """Makes the calls that are due now; gives how many."""
        now_s = self.clock.now_s()
        async with self.database.read() as connection:
            due = await _due(connection, now_s)
        taken = [each for each in due if await self._take(each, now_s)]
        await asyncio.gather(*(self._call(each) for each in taken))
        return len(taken)

    async def _take(self, due: AnyRow, now_s: float) -> bool:
        """Holds a call, if no other process has taken it."""
        held = update(webhook).where(
            webhook.c.job_number == due.number, webhook.c.tries == due.tries, webhook.c.due_s == due.due_s
        )
        async with self.database.write() as tx:
            return (await tx.execute(held.values(tries=due.tries + 1, due_s=now_s + HELD_S))).rowcount == 1

    async def _call(self, due: AnyRow) -> None:
        tries, again_s = due.tries + 1, None
        body = await self._body(due)
        timestamp = str(int(self.clock.now_s()))
        headers = {TIMESTAMP_HEADER: timestamp, SIGNATURE_HEADER: self.key.sign(signed_bytes(timestamp, body))}
        try:
            said = f"delivered: answered {await call(due.url, headers, body, self.reach)}"
        except RefusedError as error:
            said = f"given up: {error}"
        except FailedError as error:
            again_s = AGAIN_AFTER_S[tries - 1] if tries <= len(AGAIN_AFTER_S) else None
            said = f"given up after {tries} tries: {error}" if again_s is None else f"try {tries} failed: {error}"
        log.info("webhook", job=due.job_id, tries=tries, said=said)
        due_s = None if again_s is None else self.clock.now_s() + again_s
        done = update(webhook).where(webhook.c.job_number == due.number, webhook.c.tries == tries)
        async with self.database.write() as tx:
            await tx.execute(done.values(due_s=due_s, said=said))

    async def _body(self, due: AnyRow) -> bytes:
        async with self.database.read() as connection:
            row = await views.job_row(connection, due.job_id, None)
            (shown,) = await views.show_jobs(connection, [row], self.fleet, self.clock.now_s())
        return WebhookCall(farm=self.farm, job=shown).model_dump_json().encode()


async def _due(connection: AsyncConnection, now_s: float) -> Sequence[AnyRow]:
    """Calls of jobs that have ended."""
    wanted = (
        select(webhook.c.url, webhook.c.tries, webhook.c.due_s, job.c.number, job.c.job_id)
        .join(job, job.c.number == webhook.c.job_number)
        .where(webhook.c.due_s <= now_s, job.c.state.in_(FINAL_JOB_STATES))
        .order_by(webhook.c.due_s)
        .limit(AT_ONCE)
    )
    return (await connection.execute(wanted)).all()
