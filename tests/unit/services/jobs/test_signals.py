import asyncio

from services.jobs.signals import Signals


async def test_a_change_between_watching_and_waiting_is_not_missed():
    signals = Signals()
    changed = signals.watch("j1")
    signals.job_changed("j1")
    await asyncio.wait_for(changed.wait(), 60)


async def test_another_jobs_change_wakes_nobody():
    signals = Signals()
    changed = signals.watch("j1")
    signals.job_changed("j2")
    assert not changed.is_set()


async def test_the_dispatcher_wakes_at_once_and_after_its_time_looks_at_everything():
    signals = Signals()
    signals.wake_dispatcher()
    assert not await signals.dispatcher_woken(600)
    signals.wake_dispatcher(urgent=True)
    assert await signals.dispatcher_woken(600)
    assert await signals.dispatcher_woken(0.01)


async def test_closing_ends_all_waiting():
    signals = Signals()
    changed = signals.watch("j1")
    signals.close()
    assert changed.is_set()
    await asyncio.wait_for(signals.dispatcher_woken(600), 60)


async def test_a_dispatcher_that_is_woken_all_the_time_looks_at_everything_as_often():
    signals, looked = Signals(), []
    async with asyncio.timeout(120):
        while sum(looked) < 3:
            signals.wake_dispatcher()
            looked.append(await signals.dispatcher_woken(0.05))
            await asyncio.sleep(0.01)
    assert len(looked) > 2 * sum(looked), "and no more often"


async def test_nothing_is_kept_of_a_job_that_nobody_waits_for_any_more():
    signals = Signals()
    changed = signals.watch("j1")
    assert signals.watch("j1") is changed
    del changed
    assert not signals._history
