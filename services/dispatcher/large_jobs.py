"""Large jobs go on beside everything else: trials are made ahead of the robots, and the report is made before the job ends."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

import structlog

from services.database.database import AWAY, Database
from services.database.rows import AnyRow
from services.jobs import completion, filling, lists, outcomes, reports
from services.jobs.clock import FarmClock, iso
from services.jobs.lease import UNENDED
from services.jobs.signals import Signals

log = structlog.get_logger()
LOOK_EVERY_S = 0.5
READ_AT_ONCE = 500


@dataclass
class LargeJobs:
    """Does what large jobs need; keeps nothing, so that whoever looks next goes on after a process that was killed."""

    database: Database
    clock: FarmClock
    signals: Signals
    page: int

    async def look(self) -> None:
        """Makes pages of trials, one of each job in turn, until all have enough; then ends what is done."""
        while wanting := [row for row in await self._unfinished() if filling.wants_trials(row, self.page)]:
            for row in wanting:
                began_s = time.monotonic()
                async with self.database.write(lasting=False) as tx:
                    made = await filling.fill(tx, row, self.page)
                if made:
                    self.signals.wake_dispatcher()
                await asyncio.sleep(time.monotonic() - began_s)  # others write as long
        for row in await self._unfinished():
            try:
                if filling.is_done(row):
                    await self._end(row)
                elif row.state not in UNENDED:
                    await self._keep_outcomes(row)
            except AWAY:
                raise
            except Exception:  # one job must not keep the others
                log.exception("a large job could not be ended", job=row.job_id)

    async def _unfinished(self) -> list[AnyRow]:
        async with self.database.read() as connection:
            return list(await filling.unfinished(connection))

    async def _end(self, row: AnyRow) -> None:
        """Makes the report from pages of trials, and ends the job with it; nothing is kept of one that was killed in between."""
        tally = reports.Tally()
        told: list[str] = []
        async for trials, attempts in self._pages(row.number):
            await asyncio.to_thread(tally.add, trials, attempts)
            told += [outcomes.of_row(each) for each in trials]
        async with self.database.read() as connection:
            done = await lists.job_of(connection, row.number)
        at = iso(self.clock.now_s())
        body = await asyncio.to_thread(lambda: reports.body_of(tally.report(done, at, reports.versions(), None)))
        async with self.database.write() as tx:
            ended = await completion.end_large(tx, self.clock.now_s(), at, row.number, body, "".join(told))
        if ended:
            log.info("large job ended", job=row.job_id, trials=row.trials)
            self.signals.job_changed(row.job_id)

    async def _keep_outcomes(self, row: AnyRow) -> None:
        """Of a job that was cancelled or has failed; see ``outcomes.of_job``."""
        told: list[str] = []
        async for trials, _ in self._pages(row.number, attempts=False):
            told += outcomes.counted(trials, row.state)
        told.append(outcomes.unmade(row, len(told)))
        async with self.database.write(lasting=False) as tx:
            await filling.keep_outcomes(tx, row, "".join(told))

    async def _pages(self, number: int, *, attempts: bool = True) -> AsyncIterator[tuple[list[AnyRow], list[AnyRow]]]:
        after = -1
        while True:
            async with self.database.read() as connection:
                trials = await lists.some_trials(connection, number, after, READ_AT_ONCE)
                tried = await reports.attempts_of(connection, trials) if attempts else []
            yield list(trials), list(tried)
            if len(trials) < READ_AT_ONCE:
                return
            after = trials[-1].ordinal
