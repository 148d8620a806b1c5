"""Looks at open questions, and ladders that give rungs up, whenever one of their jobs has changed, before leases are given."""

from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field

import structlog
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.database import AWAY, Database
from services.jobs import judging, questions, racing
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals

log = structlog.get_logger()
Alone = Callable[[], AbstractAsyncContextManager[AsyncConnection]]


Move = Callable[[AsyncConnection, float, int, Collection[str]], Awaitable[Sequence[str]]]
MOVES: dict[str, Move] = {"question": judging.move, "ladder": racing.move}


@dataclass
class Judge:
    """Brings questions and ladders that give rungs up forward; owns what it has seen, so as to read trials after changes only.

    ``alone`` opens a transaction that no other dispatcher is in.
    """

    database: Database
    clock: FarmClock
    signals: Signals
    alone: Alone
    _seen: dict[tuple[str, int], tuple[object, ...]] = field(default_factory=dict)
    _failed: dict[tuple[str, int], tuple[object, ...]] = field(default_factory=dict)
    """Told in the log once."""

    async def look(self, robots: Collection[str], *, also_failed: bool) -> None:
        """Puts the next goals of open questions and ladders into the queue for these robots, and ends what is answered.

        Args:
            robots: who is in service.
            also_failed: whether those that could not be brought forward are tried again though nothing of them has changed.
        """
        async with self.database.read() as connection:
            rows = await questions.open_ones(connection)
            ladders = await racing.open_ones(connection)
        seen: dict[tuple[str, int], tuple[object, ...]] = {
            ("question", row.job_number): (row.last_event, row.other_event, frozenset(robots)) for row in rows
        }
        seen |= {("ladder", number): (*events, frozenset(robots)) for number, events in ladders.items()}
        failed = {}
        for (kind, number), state in seen.items():
            if self._seen.get((kind, number)) == state:
                continue
            if not also_failed and self._failed.get((kind, number)) == state:
                failed[kind, number] = state
                continue
            try:
                async with self.alone() as tx:
                    ended = await MOVES[kind](tx, self.clock.now_s(), number, robots)
            except (*AWAY, TimeoutError):
                raise
            except Exception:  # one question must not keep the farm's leases
                if self._failed.get((kind, number)) != state:
                    log.exception(f"a {kind} could not be brought forward", number=number)
                failed[kind, number] = state
                continue
            for job_id in ended:
                log.info(f"{kind} answered", job=job_id)
                self.signals.job_changed(job_id)
            if ended:
                self.signals.wake_dispatcher(urgent=True)  # what still runs of them is stopped
        self._seen, self._failed = {each: state for each, state in seen.items() if each not in failed}, failed
