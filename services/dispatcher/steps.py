"""Short pieces of work that the dispatcher does not wait for: an offer, a command, a row."""

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any

import structlog

from services.jobs.signals import Signals

log = structlog.get_logger()


@dataclass
class Steps:
    """Owns the tasks it started; none can fail unseen."""

    signals: Signals
    _running: set[asyncio.Task[None]] = field(default_factory=set)
    _is_over: bool = False

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Starts the work beside the caller, unless the process is about to stop."""
        if self._is_over:
            work.close()
            return
        started = asyncio.get_running_loop().create_task(work)
        self._running.add(started)
        started.add_done_callback(self._finished)

    def _finished(self, ended: asyncio.Task[None]) -> None:
        self._running.discard(ended)
        if not ended.cancelled() and (error := ended.exception()) is not None:
            log.error("dispatcher failed a step", error=repr(error), exc_info=error)
            self.signals.wake_dispatcher(urgent=True)

    async def finish(self, within_s: float) -> None:
        """Waits for what is under way."""
        if self._running:
            await asyncio.wait(self._running, timeout=within_s)

    async def close(self, within_s: float) -> None:
        """Waits for what is under way; what is asked for from now on is left to whoever serves next."""
        self._is_over = True
        await self.finish(within_s)
