"""What wakes those who wait inside this process: the dispatcher, and readers of a job's history."""

import asyncio
import time
from collections.abc import Callable
from weakref import WeakValueDictionary


class Signals:
    """Wake-ups without content: whoever wakes reads the truth from the database. Lives on one event loop.

    ``tell_others`` passes changes on to other processes of the services, where there may be some: the id of the job that
    changed, or None when it was something else.
    """

    def __init__(self) -> None:
        self._dispatch = asyncio.Event()
        # As long as somebody waits: of most jobs the last change is one that nobody is woken for any more.
        self._history: WeakValueDictionary[str, asyncio.Event] = WeakValueDictionary()
        self._urgent = False
        self._looked_s = time.monotonic()
        self.closing = asyncio.Event()
        self.tell_others: Callable[[str | None], None] = lambda _job_id: None

    def wake_dispatcher(self, *, urgent: bool = False) -> None:
        """Something changed that may let a lease be given; ``urgent`` also has running leases looked at now."""
        self._urgent = self._urgent or urgent
        self._dispatch.set()

    async def dispatcher_woken(self, timeout_s: float) -> bool:
        """Waits for a wake-up; true when running leases should be looked at.

        That is so at the latest ``timeout_s`` after the last time, however often it is woken: where many robots work,
        something happens all the time.
        """
        due_s = self._looked_s + timeout_s
        try:
            async with asyncio.timeout(max(0.0, due_s - time.monotonic())):
                await self._dispatch.wait()
        except TimeoutError:
            self._urgent = True
        self._dispatch.clear()
        now_s = time.monotonic()
        look, self._urgent = self._urgent or now_s >= due_s, False
        if look:
            self._looked_s = now_s
        return look

    def watch(self, job_id: str) -> asyncio.Event:
        """An event that is set at the job's next change; ask before reading, or a change may slip between."""
        return self._history.setdefault(job_id, asyncio.Event())

    def watch_robot(self, robot: str) -> asyncio.Event:
        """An event that is set when the robot next shows itself, or loses its trial."""
        return self.watch(f"robot {robot}")

    def robot_moved(self, robot: str) -> None:
        """Wakes those who watch the robot, here; every process hears it for itself."""
        self._wake_readers(f"robot {robot}")

    def job_changed(self, job_id: str) -> None:
        """Wakes the readers of the job's history, here and elsewhere; call after the commit."""
        self._wake_readers(job_id)
        self.tell_others(job_id)

    def changed_elsewhere(self, job_id: str | None) -> None:
        """Another process has changed the job, or something else of the farm."""
        if job_id is not None:
            self._wake_readers(job_id)
        # A job changes with each of its leases; what of them has to end is seen at the next look at those that run.
        self.wake_dispatcher(urgent=job_id is None)

    def _wake_readers(self, job_id: str) -> None:
        if (waiting := self._history.pop(job_id, None)) is not None:
            waiting.set()

    def close(self) -> None:
        """Ends all waiting: the process stops."""
        self.closing.set()
        for job_id in list(self._history):
            self._wake_readers(job_id)
        self._dispatch.set()
