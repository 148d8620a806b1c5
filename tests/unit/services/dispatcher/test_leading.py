"""One of several dispatchers leads, and another does when it is gone."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from prometheus_client import CollectorRegistry, Gauge
from sqlalchemy import update

from services.database.tables import leader
from services.dispatcher import leading
from services.dispatcher.leading import Leadership


@pytest.fixture
def three(database):
    """Three on one database."""
    return [Leadership(database, Gauge("leads", "", registry=CollectorRegistry())) for _ in range(3)]


async def looks(candidates, *, is_of_use=True):
    for each in candidates:
        await each.look(is_of_use=is_of_use)
    return [each.leads for each in candidates]


async def test_alone_on_its_database_it_always_leads(database, three):
    if database.is_shared:
        pytest.skip("others may share this one")
    assert [each.leads for each in three] == [True, True, True]


@pytest.fixture
def quick(database, monkeypatch):
    """Times of a moment."""
    if not database.is_shared:
        pytest.skip("nobody shares SQLite")
    for name, value in {"LEADS_S": 0.6, "OF_NO_USE_S": 0.3, "STANDS_BACK_S": 0.3}.items():
        monkeypatch.setattr(leading, name, value)


async def test_the_first_leads_until_it_has_said_nothing_for_a_while(three, quick):
    assert await looks(three) == [True, False, False]
    for _ in range(8):
        await asyncio.sleep(0.1)
        assert await looks(three) == [True, False, False]
    await asyncio.sleep(0.7)
    assert await looks(three[1:]) == [True, False]
    assert await looks(three[:1]) == [False]


async def test_who_lets_go_is_followed_at_once(three, quick):
    assert await looks(three) == [True, False, False]
    await three[0].let_go()
    assert await looks(three[1:]) == [True, False]
    assert not three[0].leads


async def test_who_is_of_no_use_lets_another_try_and_comes_again(three, quick):
    assert await looks(three, is_of_use=False) == [True, False, False]
    await asyncio.sleep(0.4)
    assert await looks(three, is_of_use=False) == [False, True, False]
    await asyncio.sleep(0.4)
    assert (await looks(three[1:2], is_of_use=False), await looks(three[:1])) == ([False], [True])


async def test_a_clock_that_went_back_keeps_nobody_from_leading(database, three, quick):
    assert await looks(three) == [True, False, False]
    async with database.write() as tx:
        await tx.execute(update(leader).values(until_s=leader.c.until_s + 3600.0))
    assert await looks(three[1:]) == [True, False]


async def test_who_was_stopped_for_a_while_knows_that_its_time_is_over(three, quick):
    assert await looks(three[:1]) == [True]
    await asyncio.sleep(0.7)  # nobody asked, as in a process that was stopped
    assert [each.leads for each in three] == [False, False, False]


async def test_a_database_that_says_nothing_ends_the_lead_in_time(three, quick, monkeypatch):
    assert await looks(three[:1]) == [True]
    monkeypatch.setattr(three[0].database, "single", silent)
    with pytest.raises(TimeoutError):
        await three[0].look(is_of_use=True)
    assert not three[0].leads


@asynccontextmanager
async def silent():
    await asyncio.sleep(60.0)
    yield
