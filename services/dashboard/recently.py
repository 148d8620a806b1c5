"""What was read of the database a moment ago, for all who look meanwhile."""

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Asked = TypeVar("Asked", bound=Hashable)
Read = TypeVar("Read")
MOST_KEPT = 100
"""Beyond that what was read first is forgotten."""


@dataclass
class Recently(Generic[Asked, Read]):
    """What was read within ``kept_s``, by what was asked for; belongs to the event loop.

    One reads while others wait for the same, so that many who look at once cost as much as one.
    """

    kept_s: float
    _known: OrderedDict[Asked, tuple[float, Read]] = field(default_factory=OrderedDict)
    _locks: dict[Asked, asyncio.Lock] = field(default_factory=dict)

    async def look(self, asked: Asked, now_s: float, read: Callable[[], Awaitable[Read]]) -> Read:
        """What was read for ``asked`` a moment ago, or what ``read`` gives now; ``now_s`` is the farm's time."""
        async with self._locks.setdefault(asked, asyncio.Lock()):
            known = self._known.get(asked)
            if known is not None and 0.0 <= now_s - known[0] <= self.kept_s:
                return known[1]
            self._known.pop(asked, None)
            try:
                found = await read()
            except BaseException:
                self._locks.pop(asked, None)  # what cannot be read may be anything, and is not remembered
                raise
            self._known[asked] = (now_s, found)
            if len(self._known) > MOST_KEPT:
                first, _ = self._known.popitem(last=False)
                self._locks.pop(first, None)
            return found
