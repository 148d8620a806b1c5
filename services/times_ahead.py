"""Times that were noted before the farm's clock went back: left as they are, they would hold things up until it has caught up."""

from collections.abc import Iterator

from sqlalchemy import Update, update

from services.database.database import Database
from services.database.tables import physics, robot, trial, turn, webhook, why
from services.jobs import lease
from services.jobs.explainer import SPARE_S
from services.settings import Settings
from services.webhooks.delivery import AGAIN_AFTER_S, HELD_S


async def bring_back(database: Database, now_s: float, settings: Settings) -> None:
    """Brings what lies further ahead than it may to where it may be: what has happened to now, what is due to its longest wait.

    Each in a transaction of its own, so that nobody waits for more than one of them.
    """
    for statement in _statements(now_s, settings):
        async with database.write() as tx:
            await tx.execute(statement)
    async with database.write() as tx:
        await lease.shorten(tx, now_s + settings.lease_s)


def _statements(now_s: float, settings: Settings) -> Iterator[Update]:
    queued = trial.c.state == "queued"  # what an index finds
    yield update(trial).where(queued, trial.c.passed_over_s > now_s).values(passed_over_s=now_s)
    for column in (turn.c.served_s, robot.c.canary_s, physics.c.told_s):
        yield update(column.table).where(column > now_s).values({column.name: now_s})
    longest = ((why.c.due_s, settings.why_deadline_s + SPARE_S), (webhook.c.due_s, max(*AGAIN_AFTER_S, HELD_S)))
    for column, wait_s in longest:
        yield update(column.table).where(column > now_s + wait_s).values({column.name: now_s + wait_s})
