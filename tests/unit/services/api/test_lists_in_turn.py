"""Lists of trials cost the services most of what users ask for often: whoever asks for many waits for their own alone."""

import asyncio
import json
from contextlib import AsyncExitStack
from types import SimpleNamespace

import pytest

from services.api import trials
from services.database.pages import Asked
from services.errors import TooMany
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.tokens import Caller
from services.turns import MOST_WAITING, Turns
from tests.unit.services.dispatcher.conftest import add_trials, database  # noqa: F401  a fixture


async def test_one_list_is_made_at_a_time_and_owners_take_turns(database):  # noqa: F811
    await add_trials(database, [("a",)] * 3)
    turns = Turns()
    request = SimpleNamespace(app=SimpleNamespace(state=SimpleNamespace(lists=turns)))
    farm = SimpleNamespace(database=database, fleet=Fleet(), clock=FarmClock.start())
    owner = Caller("t", "o", frozenset())

    async def asks():
        return await trials.list_trials("j1", request, owner, farm, Asked(2))

    answer = json.loads((await asks()).body)
    assert [each["ordinal"] for each in answer["trials"]] == [0, 1] and answer["next_cursor"] is not None
    async with AsyncExitStack() as held:
        await held.enter_async_context(turns.of("another"))
        waiting = [asyncio.create_task(asks()) for _ in range(MOST_WAITING)]
        await asyncio.sleep(0.05)
        assert not any(each.done() for each in waiting), "another owner has the turn"
        with pytest.raises(TooMany):
            await asks()
    assert len(await asyncio.gather(*waiting)) == MOST_WAITING
