"""What is written at the same time shares a transaction, and what is wrong with one of it is that one's alone."""

import asyncio
from collections import defaultdict
from contextlib import asynccontextmanager

import pytest
from sqlalchemy import insert, select
from sqlalchemy.exc import IntegrityError

from services.database import together
from services.database.database import Database
from services.database.tables import turn
from services.database.together import Together
from services.errors import Conflict, Unavailable


class Counted:
    """A database that counts its transactions; the first ``away`` of them find it gone."""

    def __init__(self, database: Database, away=0):
        self.database, self.away, self.written, self.of = database, away, [], {}

    @asynccontextmanager
    async def write(self, *, lasting=True):
        if self.away:
            self.away -= 1
            raise Unavailable("database-unavailable", "away")
        async with self.database.write(lasting=lasting) as tx:
            self.written.append([])
            self.of[id(tx)] = self.written[-1]
            yield tx


def writer(counted, **how):
    async def one(tx, name):
        if name == "refused":
            raise Conflict("no", "not this one")
        counted.of[id(tx)].append(name)
        for _ in range(2 if name == "broken" else 1):
            await tx.execute(insert(turn).values(owner=name, served_s=0.0))
        return name.upper()

    return Together(counted, one, lambda name: name, **how)


async def kept(database):
    async with database.read() as connection:
        return set((await connection.execute(select(turn.c.owner))).scalars())


async def all_of(work):
    return await asyncio.gather(*work, return_exceptions=True)


async def test_what_comes_while_one_is_written_is_written_with_the_next_in_the_order_of_its_rows(new_database):
    counted = Counted(new_database)
    write = writer(counted).write
    assert await all_of(write(name) for name in ("c", "b", "a")) == ["C", "B", "A"]
    first, *rest = counted.written
    assert [*first, *(name for each in rest for name in each)] in (["a", "b", "c"], ["c", "a", "b"])
    assert len(counted.written) <= 2
    assert await kept(new_database) == {"a", "b", "c"}


async def test_a_refusal_is_of_one_alone(new_database):
    write = writer(Counted(new_database)).write
    came = await all_of(write(name) for name in ("a", "refused", "z"))
    assert (came[0], type(came[1]), came[2]) == ("A", Conflict, "Z")
    assert await kept(new_database) == {"a", "z"}


async def test_what_breaks_its_transaction_keeps_no_other(new_database):
    write = writer(Counted(new_database)).write
    came = await all_of(write(name) for name in ("a", "broken", "z"))
    assert (came[0], type(came[1]), came[2]) == ("A", IntegrityError, "Z")
    assert await kept(new_database) == {"a", "z"}


async def test_who_waits_while_the_database_is_away_hears_so_and_nothing_is_tried_again(new_database):
    counted = Counted(new_database, away=1)
    write = writer(counted).write
    assert [type(each) for each in await all_of(write(name) for name in "ab")] == [Unavailable, Unavailable]
    assert counted.written == []
    assert await write("a") == "A"


async def test_no_transaction_has_more_than_some_and_queues_do_not_wait_for_each_other(new_database, monkeypatch):
    monkeypatch.setattr(together, "AT_ONCE", 3)
    counted = Counted(new_database)
    write = writer(counted).write
    names = [f"{number:02d}" for number in range(10)]
    assert await all_of(write(name, int(name) % 2) for name in names) == names
    queue_of = defaultdict(set)
    for number, each in enumerate(counted.written):
        assert len(each) <= 3
        queue_of[number] |= {int(name) % 2 for name in each}
    assert all(len(queues) == 1 for queues in queue_of.values())


async def test_who_does_not_wait_any_more_keeps_nobody(new_database):
    write = writer(Counted(new_database)).write
    gone = asyncio.ensure_future(write("gone"))
    stays = asyncio.ensure_future(write("stays"))
    await asyncio.sleep(0)
    gone.cancel()
    assert await stays == "STAYS"
    with pytest.raises(asyncio.CancelledError):
        await gone
    assert await kept(new_database) == {"gone", "stays"}
