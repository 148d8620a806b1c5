"""What wakes those who wait inside this process: the dispatcher, and readers of a job's history."""

import asyncio


class Signals:
    """Wake-ups without content: whoever wakes reads the truth from the database. Lives on one event loop."""

    def __init__(self) -> None:
        self._dispatch = asyncio.Event()
        self._history: dict[str, asyncio.Event] = {}
        self._urgent = False
        self.closing = asyncio.Event()

    def wake_dispatcher(self, *, urgent: bool = False) -> None:
        """Something changed that may let a lease be given; ``urgent`` also has running leases looked at now."""
        self._urgent = self._urgent or urgent
        self._dispatch.set()

    async def dispatcher_woken(self, timeout_s: float) -> bool:
        """Waits for a wake-up, at most ``timeout_s``; true when running leases should be looked at."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._dispatch.wait()
        except TimeoutError:
            self._urgent = True
        self._dispatch.clear()
        urgent, self._urgent = self._urgent, False
        return urgent

    def watch(self, job_id: str) -> asyncio.Event:
        """An event that is set at the job's next change; ask before reading, or a change may slip between."""
        return self._history.setdefault(job_id, asyncio.Event())

    def job_changed(self, job_id: str) -> None:
        """Wakes the readers of the job's history; call after the commit."""
        if (waiting := self._history.pop(job_id, None)) is not None:
            waiting.set()

    def close(self) -> None:
        """Ends all waiting: the process stops."""
        self.closing.set()
        for job_id in list(self._history):
            self.job_changed(job_id)
        self._dispatch.set()
