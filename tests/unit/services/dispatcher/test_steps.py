"""Work that the dispatcher does not wait for, and the end of it."""

import asyncio

from services.dispatcher.steps import Steps
from services.jobs.signals import Signals


async def test_what_is_under_way_is_finished_and_nothing_begins_behind_the_end():
    done = []

    async def work(name, *then):
        await asyncio.sleep(0)
        done.append(name)
        for each in then:
            steps.start(work(each))

    steps = Steps(Signals())
    steps.start(work("before", "asked for by what is under way"))
    await steps.close(1.0)
    steps.start(work("after"))
    for _ in range(5):
        await asyncio.sleep(0)
    assert done == ["before"]


async def test_no_longer_is_waited_than_was_said():
    steps = Steps(Signals())
    steps.start(asyncio.sleep(30))
    await asyncio.wait_for(steps.close(0.01), 5)
