"""What is asked to be written at the same time, written together: a transaction costs as much as a dozen statements."""

import asyncio
from collections.abc import Awaitable, Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.database import Database, is_away
from services.errors import ServiceError

AT_ONCE = 16
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass
class Together(Generic[Item, Result]):
    """Owns what waits for its turn. Nothing waits for others to come: while one transaction is written, the next gathers.

    ``one`` writes an item; where it raises a ``ServiceError``, which is its item's alone, it has written nothing. What else goes
    wrong has all tried again one by one, so that what is wrong with one does not keep the others. ``key`` gives the order in
    which a transaction takes items: that of the rows which they take, so that no two wait for each other. ``before``
    sees all items of a transaction first. ``lasting`` is as in ``Database.write``.
    """

    database: Database
    one: Callable[[AsyncConnection, Item], Awaitable[Result]]
    key: Callable[[Item], str]
    before: Callable[[AsyncConnection, Sequence[Item]], Awaitable[None]] | None = None
    lasting: bool = True
    _waiting: dict[Hashable, list[tuple[Item, asyncio.Future[Result]]]] = field(default_factory=dict)
    _writing: set[asyncio.Task[None]] = field(default_factory=set)

    async def write(self, item: Item, queue: Hashable = None) -> Result:
        """Returns when it is committed. Items of different queues are not written together, but at the same time."""
        answer: asyncio.Future[Result] = asyncio.get_running_loop().create_future()
        if queue in self._waiting:
            self._waiting[queue].append((item, answer))
        else:
            self._waiting[queue] = [(item, answer)]
            writing = asyncio.get_running_loop().create_task(self._write_waiting(queue))
            self._writing.add(writing)
            writing.add_done_callback(self._writing.discard)
        return await answer

    async def _write_waiting(self, queue: Hashable) -> None:
        while waiting := self._waiting[queue]:
            self._waiting[queue] = waiting[AT_ONCE:]
            await self._write(waiting[:AT_ONCE])
        del self._waiting[queue]

    async def _write(self, waiting: Sequence[tuple[Item, asyncio.Future[Result]]]) -> None:
        asked = sorted(waiting, key=lambda each: self.key(each[0]))
        try:
            async with self.database.write(lasting=self.lasting) as tx:
                if self.before is not None:
                    await self.before(tx, [item for item, _ in asked])
                found = [await self._one(tx, item) for item, _ in asked]
        except Exception as error:
            if len(asked) == 1 or is_away(error):
                _tell(asked, [error] * len(asked))
                return
            for each in asked:
                await self._write([each])
        else:
            _tell(asked, found)

    async def _one(self, tx: AsyncConnection, item: Item) -> Result | ServiceError:
        try:
            return await self.one(tx, item)
        except ServiceError as refusal:
            return refusal


def _tell(asked: Sequence[tuple[Item, asyncio.Future[Result]]], found: Sequence[Result | Exception]) -> None:
    for (_, answer), came in zip(asked, found, strict=True):
        if answer.done():  # nobody waits for it any more
            continue
        if isinstance(came, Exception):
            answer.set_exception(came)
        else:
            answer.set_result(came)
