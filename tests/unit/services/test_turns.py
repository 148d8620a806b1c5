"""Whoever has many requests has one place in the line, and not without end."""

import asyncio

import pytest

from services.errors import TooMany
from services.turns import MOST_WAITING, Turns


async def test_each_owner_has_one_place():
    turns, order, begins = Turns(), [], asyncio.Event()

    async def asks(owner):
        async with turns.of(owner):
            order.append(owner)
            await begins.wait()

    asked = [asyncio.create_task(asks(owner)) for owner in ("ann", "ann", "ann", "bob", "cid")]
    await asyncio.sleep(0)
    begins.set()
    await asyncio.gather(*asked)
    assert order == ["ann", "bob", "cid", "ann", "ann"]


async def test_who_has_too_many_waiting_is_told_so_and_others_are_not():
    turns, ends = Turns(), asyncio.Event()

    async def asks(owner):
        async with turns.of(owner):
            await ends.wait()

    waiting = [asyncio.create_task(asks("ann")) for _ in range(MOST_WAITING)]
    await asyncio.sleep(0)
    with pytest.raises(TooMany, match="of ann wait"):
        await asks("ann")
    others = asyncio.create_task(asks("bob"))
    await asyncio.sleep(0)
    for each in waiting[1:]:
        each.cancel()
    ends.set()
    await asyncio.gather(others, waiting[0])
    await asks("ann")
    assert not turns._waiting
