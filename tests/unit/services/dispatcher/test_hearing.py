"""A process that came anew is given nothing until what the last one of its name held has been ended."""

import asyncio

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.dispatcher.hearing import Hearing
from services.dispatcher.overdue import LeaseEnder
from services.dispatcher.steps import Steps
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals
from services.settings import Settings


def beat(instance):
    return Heartbeat(robot="robot-0", instance=instance, pid=1, host="h", state=RobotState.IDLE)


async def test_a_new_process_waits_for_what_the_last_one_held(new_database, tmp_path):
    clock, fleet, signals = FarmClock.start(), Fleet(), Signals()
    steps, ender = Steps(signals), LeaseEnder(Settings(data=tmp_path), new_database, clock, fleet, signals)
    hearing = Hearing(new_database, clock, fleet, signals, steps, ender)

    def ready():
        return fleet.ready(clock.now_s())

    fleet.token_changed("robot-0", present=True, now_s=clock.now_s())
    hearing._heard(beat("one"))
    await steps.finish(10.0)
    assert ready() == ("robot-0",)
    hearing._heard(beat("two"))
    assert ready() == (), "a lease given now would be ended as that of the process before"
    hearing._heard(beat("two"))
    assert ready() == ()
    await steps.finish(10.0)
    assert ready() == ("robot-0",)


async def test_it_does_not_wait_for_ever_for_a_database_that_is_away(new_database, tmp_path):
    clock, fleet, signals = FarmClock.start(), Fleet(), Signals()
    steps, ender = Steps(signals), LeaseEnder(Settings(data=tmp_path), new_database, clock, fleet, signals)
    async with new_database.write() as tx:
        await tx.exec_driver_sql("ALTER TABLE robot RENAME TO gone")
    fleet.token_changed("robot-0", present=True, now_s=clock.now_s())
    Hearing(new_database, clock, fleet, signals, steps, ender)._heard(beat("one"))
    await steps.finish(10.0)
    await asyncio.sleep(0)
    assert fleet.ready(clock.now_s()) == ("robot-0",)
    async with new_database.write() as tx:
        await tx.exec_driver_sql("ALTER TABLE gone RENAME TO robot")
