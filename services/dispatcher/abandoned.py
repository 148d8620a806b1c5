"""Jobs whose one robot is gone for good: out of service or lost for so long that nobody should wait for it any more."""

from dataclasses import dataclass, field

import structlog

from services.database.database import Database
from services.database.rows import AnyRow
from services.dispatcher import queue
from services.dispatcher.finding import why_unfit
from services.jobs import completion
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals

log = structlog.get_logger()


@dataclass
class Abandoner:
    """Fails jobs that are pinned to a robot that is gone; owns since when each robot has been so."""

    database: Database
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    gone_s: float
    _since_s: dict[str, float] = field(default_factory=dict)

    def begin_anew(self) -> None:
        """Forgets since when robots are gone: while another looked after them they may have come and gone."""
        self._since_s = {}

    async def look(self) -> None:
        """Notes who is gone, and fails the jobs that have waited for such a robot for longer than ``gone_s``."""
        async with self.database.read() as connection:
            rows = await queue.pinned(connection)
        now_s = self.clock.now_s()
        self._note({row.robot for row in rows}, now_s)
        for row in rows:
            since_s = self._since_s.get(row.robot)
            # A robot that was gone when its job came has all of that time to come back.
            if since_s is not None and now_s - max(since_s, row.created_s) >= self.gone_s:
                await self._fail(row, now_s)

    def _note(self, wanted: set[str], now_s: float) -> None:
        gone = {robot for robot in wanted if self._is_gone(robot, now_s)}
        self._since_s = {robot: self._since_s.get(robot, now_s) for robot in gone}

    def _is_gone(self, robot: str, now_s: float) -> bool:
        member = self.fleet.snapshot(robot)
        return member is None or member.is_gone(now_s)

    async def _fail(self, row: AnyRow, now_s: float) -> None:
        left, doing = row.trials - row.trials_done, why_unfit(self.fleet, now_s)(row.robot)
        which = f"which {doing} and was away for {self.gone_s:g} s"
        reason = f"{left} of {row.trials} trials could run on {row.robot} alone, {which}"
        async with self.database.write() as tx:
            ended = await completion.abandon(tx, self.clock.now_s(), row.number, reason)
        if ended:
            log.warning("job failed, its robot is gone", job=row.job_id, reason=reason)
            self.signals.job_changed(row.job_id)
