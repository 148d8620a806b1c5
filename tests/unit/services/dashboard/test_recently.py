"""Many who look at once cost one reading, and nobody is shown what is too old."""

import asyncio

from services.dashboard.recently import MOST_KEPT, Recently


def test_who_looks_meanwhile_shares_what_was_read_and_who_looks_later_does_not():
    read = []

    async def reading():
        read.append(len(read))
        await asyncio.sleep(0)
        return read[-1]

    async def looks():
        recently = Recently[str, int](kept_s=3.0)
        at_once = await asyncio.gather(*(recently.look("a", 100.0, reading) for _ in range(20)))
        later = [await recently.look("a", now_s, reading) for now_s in (102.9, 103.1, 105.0, 106.2)]
        back = await recently.look("a", 50.0, reading)  # the clock went back: what was read then is of the future
        return at_once, later, back, await recently.look("b", 50.0, reading)

    assert asyncio.run(looks()) == ([0] * 20, [0, 1, 1, 2], 3, 4)


def test_a_reading_that_fails_is_tried_again_and_what_was_read_first_is_forgotten():
    async def failing():
        raise OSError

    async def number():
        return 1

    async def looks():
        recently = Recently[int, int](kept_s=3.0)
        failed = await asyncio.gather(recently.look(0, 0.0, failing), return_exceptions=True)
        for asked in range(MOST_KEPT + 1):
            await recently.look(asked, 0.0, number)
        forgotten = await asyncio.gather(recently.look(0, 0.0, failing), return_exceptions=True)
        assert len(recently._locks) == MOST_KEPT
        return failed + forgotten, await recently.look(MOST_KEPT, 0.0, failing)

    found, kept = asyncio.run(looks())
    assert all(isinstance(each, OSError) for each in found) and kept == 1


def test_who_looks_for_another_thing_does_not_wait():
    async def looks():
        recently, goes_on = Recently[str, str](kept_s=3.0), asyncio.Event()

        async def slow():
            await goes_on.wait()
            return "slow"

        async def quick():
            return "quick"

        first = asyncio.create_task(recently.look("a", 0.0, slow))
        await asyncio.sleep(0)
        found = await asyncio.wait_for(recently.look("b", 0.0, quick), 120.0)
        goes_on.set()
        return found, await first

    assert asyncio.run(looks()) == ("quick", "slow")
