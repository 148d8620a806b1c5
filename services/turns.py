"""Turns at what is made for few at a time: each owner has one place in the line, however many of their requests wait."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from weakref import WeakValueDictionary

from services.errors import TooMany

MOST_WAITING = 20
"""Requests of one owner that wait or are being answered."""
RETRY_AFTER_S = 5


class Turns:
    """Lets ``at_once`` go on together and has the others wait, one of each owner; belongs to the event loop."""

    def __init__(self, at_once: int = 1) -> None:
        self._free = asyncio.Semaphore(at_once)
        self._places: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self._waiting: Counter[str] = Counter()

    @asynccontextmanager
    async def of(self, owner: str) -> AsyncIterator[None]:
        """A turn of the owner's, which lasts as long as the block.

        Raises:
            TooMany: ``MOST_WAITING`` of theirs wait already.
        """
        if self._waiting[owner] >= MOST_WAITING:
            detail = f"{MOST_WAITING} requests of {owner} wait for what is made one at a time, the limit; wait for some of them."
            raise TooMany("too-many-waiting", detail, RETRY_AFTER_S)
        self._waiting[owner] += 1
        place = self._places.setdefault(owner, asyncio.Lock())
        try:
            async with place, self._free:
                yield
        finally:
            self._waiting[owner] -= 1
            self._waiting += Counter()  # forgets those of whom nothing waits any more
