"""Leases that robots accepted, written down: those of a moment together, job by job."""

import asyncio
from dataclasses import dataclass, field

from services.database.database import Database
from services.jobs import lease
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals

GATHER_S = 0.02


@dataclass
class Confirming:
    """Owns what is not written yet."""

    database: Database
    clock: FarmClock
    signals: Signals
    _waiting: dict[str, list[Claim]] = field(default_factory=dict)
    _writing: dict[str, asyncio.Task[None]] = field(default_factory=dict)

    async def confirm(self, claim: Claim, job_id: str) -> None:
        """Returns when it is written that the trial runs, or that the lease ended in the meantime."""
        if job_id not in self._waiting:
            self._waiting[job_id] = []
            self._writing[job_id] = asyncio.get_running_loop().create_task(self._write_soon(job_id))
        self._waiting[job_id].append(claim)
        await asyncio.shield(self._writing[job_id])

    async def _write_soon(self, job_id: str) -> None:
        await asyncio.sleep(GATHER_S)
        claims = self._waiting.pop(job_id)
        del self._writing[job_id]  # who waits for it has it
        async with self.database.write(lasting=False) as tx:
            confirmed = await lease.confirm_leases(tx, self.clock.now_s(), claims)
        if confirmed:
            self.signals.job_changed(job_id)
