"""What robots that hold leases ask for: to hold them longer, to keep a file, to accept an outcome."""

from collections import OrderedDict
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from sqlalchemy import bindparam, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.robot import OutcomeReport, Renewal
from services.database.database import Database
from services.database.tables import trial
from services.database.together import Together
from services.jobs import completion, lease
from services.jobs.clock import FarmClock
from services.jobs.completion import Ending
from services.jobs.locking import lock_job_of_all

JOBS_REMEMBERED = 10_000
Item = TypeVar("Item")
Result = TypeVar("Result")
Write = Callable[[AsyncConnection, Item], Awaitable[Result]]
_JOB_OF = select(trial.c.job_number).where(trial.c.trial_id == bindparam("of_trial"))


@dataclass(frozen=True)
class Reported:
    """An outcome, and the size of the log that it names."""

    trial_id: str
    report: OutcomeReport
    log_bytes: int | None


@dataclass(frozen=True)
class Uploaded:
    """A file that is stored, and under which lease it came."""

    trial_id: str
    fence: int
    kind: lease.FileKind
    sha256: str


class Holding:
    """Writes what many robots ask for at the same time together.

    Where many may write, outcomes of different jobs are written at the same time; those of one job would only wait for each other
    at its row. What asks for one trial's row alone, and need not last, is one statement there: it would wait for whatever holds
    any of the others, and a transaction takes five ways to the server instead of one.
    """

    def __init__(self, database: Database, clock: FarmClock, lease_s: float, max_attempts: int) -> None:
        self._database, self._clock, self._lease_s, self._max_attempts = database, clock, lease_s, max_attempts
        self._outcomes = Together[Reported, Ending](database, self._accept, lambda each: each.trial_id, _lock_job)
        # The file is on the disk; its row need not be, because the outcome that names it is committed after it and lasts.
        self._files = Together[Uploaded, None](database, self._keep, lambda each: each.trial_id, lasting=False)
        self._renewals = Together[tuple[str, Renewal], bool](database, self._renew, lambda each: each[0], lasting=False)
        self._jobs: OrderedDict[str, int] = OrderedDict()

    async def renew(self, trial_id: str, renewal: Renewal) -> bool:
        """Prolongs a lease; see ``lease.renew``."""
        return await self._written(self._renewals, self._renew, (trial_id, renewal))

    async def keep_file(self, uploaded: Uploaded) -> None:
        """Notes which file was uploaded under a lease; see ``lease.keep_file``."""
        await self._written(self._files, self._keep, uploaded)

    async def _written(self, together: Together[Item, Result], one: Write[Item, Result], item: Item) -> Result:
        if not self._database.is_shared:
            return await together.write(item)
        async with self._database.single() as connection:
            return await one(connection, item)

    async def accept(self, reported: Reported) -> Ending:
        """Takes a robot's outcome, and returns when it is committed; see ``completion.accept``."""
        return await self._outcomes.write(reported, await self._queue_of(reported.trial_id))

    async def _queue_of(self, trial_id: str) -> int | None:
        """The job of a trial, which never changes; None where one writes at a time anyhow."""
        if not self._database.is_shared:
            return None
        if trial_id not in self._jobs:
            async with self._database.read() as connection:
                number = (await connection.execute(_JOB_OF, {"of_trial": trial_id})).scalar_one_or_none()
            if number is None:
                return None
            self._jobs[trial_id] = number
            if len(self._jobs) > JOBS_REMEMBERED:
                self._jobs.popitem(last=False)
        return self._jobs[trial_id]

    async def _accept(self, tx: AsyncConnection, each: Reported) -> Ending:
        now_s, told = self._clock.now_s(), {"log_bytes": each.log_bytes, "max_attempts": self._max_attempts}
        return await completion.accept(tx, now_s, each.trial_id, each.report, **told)

    async def _keep(self, tx: AsyncConnection, each: Uploaded) -> None:
        await lease.keep_file(tx, each.trial_id, each.fence, each.kind, each.sha256)

    async def _renew(self, tx: AsyncConnection, each: tuple[str, Renewal]) -> bool:
        return await lease.renew(tx, self._clock.now_s(), *each, self._lease_s)


async def _lock_job(tx: AsyncConnection, reported: Sequence[Reported]) -> None:
    await lock_job_of_all(tx, [each.trial_id for each in reported])
