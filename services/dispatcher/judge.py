"""Looks at open questions whenever one of their jobs has changed, before leases are given."""

from collections.abc import Callable, Collection
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field

import structlog
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.database import AWAY, Database
from services.jobs import judging, questions
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals

log = structlog.get_logger()
Alone = Callable[[], AbstractAsyncContextManager[AsyncConnection]]


@dataclass
class Judge:
    """Brings questions forward; owns what it has seen of them, so that it reads their trials only after a change.

    ``alone`` opens a transaction that no other dispatcher is in.
    """

    database: Database
    clock: FarmClock
    signals: Signals
    alone: Alone
    _seen: dict[int, tuple[object, ...]] = field(default_factory=dict)

    async def look(self, robots: Collection[str]) -> None:
        """Puts the next goals of open questions into the queue for these robots, and ends what is answered."""
        async with self.database.read() as connection:
            rows = await questions.open_ones(connection)
        seen: dict[int, tuple[object, ...]] = {
            row.job_number: (row.last_event, row.other_event, frozenset(robots)) for row in rows
        }
        for number, state in seen.items():
            if self._seen.get(number) == state:
                continue
            try:
                async with self.alone() as tx:
                    ended = await judging.move(tx, self.clock.now_s(), number, robots)
            except AWAY:
                raise
            except Exception:  # one question must not keep the farm's leases
                log.exception("a question could not be brought forward", job=number)
                continue
            for job_id in ended:
                log.info("question answered", job=job_id)
                self.signals.job_changed(job_id)
            if ended:
                self.signals.wake_dispatcher(urgent=True)  # what still runs of them is stopped
        self._seen = seen
