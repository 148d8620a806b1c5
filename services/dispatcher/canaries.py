"""Has every idle robot try the farm's canary when it is time."""

from collections.abc import Collection
from dataclasses import dataclass

import structlog

from services.database.database import Database
from services.jobs import canary
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals

log = structlog.get_logger()
LOOK_EVERY_S = 5.0


@dataclass
class Canaries:
    """Queues the canary's jobs; owns when it last looked."""

    database: Database
    clock: FarmClock
    signals: Signals
    _looked_s: float = float("-inf")

    async def look(self, idle: Collection[str]) -> None:
        """Queues a job for each of the robots, which have nothing else to do, whose time has come."""
        now_s = self.clock.now_s()
        if not idle or now_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = now_s
        async with self.database.read() as connection:
            due = await canary.due(connection, now_s, idle)
        for robot in due:
            async with self.database.write() as tx:
                job_id = await canary.queue(tx, now_s, robot)
            if job_id is not None:
                log.info("canary queued", robot=robot, job=job_id)
                self.signals.wake_dispatcher()
                self.signals.tell_others(job_id)
