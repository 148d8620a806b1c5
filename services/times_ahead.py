"""Times that were noted before the farm's clock went back: left as they are, they would hold things up until it has caught up."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import Column, ColumnElement, func, select

from services.database.database import Database
from services.database.tables import physics, robot, trial, turn, webhook, why
from services.jobs import lease
from services.jobs.explainer import SPARE_S
from services.jobs.locking import change_free
from services.settings import Settings
from services.webhooks.delivery import AGAIN_AFTER_S, HELD_S

Which = tuple[ColumnElement[bool], ...]
Values = dict[str, Any]
_latest = physics.alias("latest")


async def bring_back(database: Database, now_s: float, settings: Settings) -> bool:
    """Brings what lies further ahead than it may to where it may be: what has happened to now, what is due to its longest wait.

    Leases come first: an overdue one keeps a trial from everybody. Each kind has a transaction of its own, which waits for nobody
    and passes over what others are changing at the moment.

    Returns:
        Whether that was all. If not, somebody was changing some of it, and it is to be done again.
    """
    async with database.write() as tx:
        all_back = await lease.shorten(tx, now_s + settings.lease_s)
    for key, which, values in _ahead(now_s, settings):
        async with database.write() as tx:
            all_back = await change_free(tx, key, which, values) and all_back
    return all_back


def _ahead(now_s: float, settings: Settings) -> Iterator[tuple[Column[Any], Which, Values]]:
    """Of each table its key, which of its rows lie ahead, and what their times become."""
    queued = trial.c.state == "queued"  # what an index finds
    yield trial.c.trial_id, (queued, trial.c.passed_over_s > now_s), {"passed_over_s": now_s}
    yield turn.c.owner, (turn.c.served_s > now_s,), {"served_s": now_s}
    yield robot.c.robot, (robot.c.canary_s > now_s,), {"canary_s": now_s}
    # All by as much as the latest: which physics was told last is the farm's.
    too_late_s = select(func.max(_latest.c.told_s) - now_s).scalar_subquery()
    yield physics.c.number, (physics.c.told_s > now_s,), {"told_s": physics.c.told_s - too_late_s}
    longest_s = settings.why_deadline_s + SPARE_S
    yield why.c.trial_id, (why.c.due_s > now_s + longest_s,), {"due_s": now_s + longest_s}
    longest_s = max(*AGAIN_AFTER_S, HELD_S)
    yield webhook.c.job_number, (webhook.c.due_s > now_s + longest_s,), {"due_s": now_s + longest_s}
