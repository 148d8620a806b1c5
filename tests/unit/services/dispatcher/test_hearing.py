"""A process that came anew is written down, and is given nothing until what the last one of its name held has been ended."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from sqlalchemy import select
from structlog.testing import capture_logs

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.database.tables import attempt, robot, trial
from services.dispatcher.hearing import GATHER_S, NAMED, Hearing
from services.dispatcher.overdue import LeaseEnder
from services.dispatcher.steps import Steps
from services.jobs import lease, robots
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals
from services.settings import Settings
from tests.unit.services.jobs.test_pinning import asked, end, take


def beat(instance, name="robot-0"):
    return Heartbeat(robot=name, instance=instance, pid=1, host="h", state=RobotState.IDLE)


class Heard:
    """A robot on the bus, and a dispatcher's ear."""

    def __init__(self, database, folder):
        self.database, self.clock, self.fleet, signals = database, FarmClock.start(), Fleet(), Signals()
        self.steps = Steps(signals)
        ender = LeaseEnder(Settings(data=folder), database, self.clock, self.fleet, signals)
        self.hearing = Hearing(database, self.clock, self.fleet, signals, self.steps, ender)
        self.fleet.token_changed("robot-0", present=True, now_s=self.clock.now_s())

    def says(self, instance):
        self.hearing._heard(beat(instance))

    async def all_done(self):
        await self.steps.finish(10.0)
        await asyncio.sleep(0)

    def ready(self):
        return self.fleet.seen(self.clock.now_s()).ready

    @asynccontextmanager
    async def cannot_write_robots_down(self):
        async with self.database.write() as tx:
            await tx.exec_driver_sql("ALTER TABLE robot RENAME TO gone")
        with capture_logs():  # to write an error out with all that belongs to it may take longer than a robot may be silent
            yield
        async with self.database.write() as tx:
            await tx.exec_driver_sql("ALTER TABLE gone RENAME TO robot")


@pytest.fixture
def heard(new_database, tmp_path):
    return Heard(new_database, tmp_path)


async def test_a_new_process_waits_for_what_the_last_one_held(heard):
    heard.says("one")
    await heard.all_done()
    assert heard.ready() == ("robot-0",)
    heard.says("two")
    assert heard.ready() == (), "a lease given now would be ended as that of the process before"
    heard.says("two")
    assert heard.ready() == ()
    await heard.all_done()
    assert heard.ready() == ("robot-0",)


async def test_who_comes_at_the_same_time_is_written_down_together_and_told_in_one_line(heard, monkeypatch):
    names, kept = [f"robot-{number}" for number in range(20)], []
    keep = robots.keep

    async def counted(tx, beats, now_s):
        kept.append(len(beats))
        return await keep(tx, beats, now_s)

    monkeypatch.setattr(robots, "keep", counted)
    with capture_logs() as lines:
        for name in names:
            heard.hearing._presence_changed(name, present=True)
            heard.hearing._heard(beat("one", name))
        await heard.all_done()
        await asyncio.sleep(2 * GATHER_S)
    assert kept == [20]
    assert [(line["event"], line["count"], len(line["robots"])) for line in lines] == [("robots came", 20, NAMED)]
    assert heard.ready() == tuple(sorted(names))


@pytest.mark.parametrize("new_database", ["postgres"], indirect=True)  # SQLite takes texts of any length
async def test_one_whose_words_cannot_be_kept_does_not_keep_others_out(heard):
    heard.hearing._heard(beat("one", "robot-1"))
    heard.hearing._heard(beat("i" * 1000, "robot-2"))
    with capture_logs() as lines:
        await heard.all_done()
    assert [(line["event"], line["robot"]) for line in lines] == [("robot not written down", "robot-2")]
    async with heard.database.read() as connection:
        assert (await connection.execute(select(robot.c.robot))).scalars().all() == ["robot-1"]


async def test_a_token_alone_gets_no_lease_that_the_next_heartbeat_would_end(heard):
    heard.says("one")
    await heard.all_done()
    for present in (False, True):
        heard.hearing._presence_changed("robot-0", present)
        assert heard.ready() == ()
    heard.says("two")
    await heard.all_done()
    assert heard.ready() == ("robot-0",)


async def test_it_does_not_wait_for_ever_for_a_database_that_is_away_and_is_written_down_later(heard):
    async with heard.cannot_write_robots_down():
        heard.says("one")
        await heard.all_done()
        await heard.hearing.keep_unkept()
    assert heard.ready() == ("robot-0",)
    await heard.hearing.keep_unkept()
    async with heard.database.read() as connection:
        assert (await connection.execute(select(robot.c.robot, robot.c.instance))).all() == [("robot-0", "one")]
    assert heard.fleet.member("robot-0").unkept is None


@pytest.mark.parametrize("new_database", ["sqlite"], indirect=True)  # those who share a database go on counting
async def test_an_outcome_that_is_under_way_while_the_services_start_anew_is_taken(heard, fleet_of):
    async with heard.database.write() as tx:
        await robots.keep(tx, [beat("one")], 1.0)
    await asked(heard.database, "robot-0")
    claim = await take(heard.database, "robot-0", fleet_of("robot-0"))
    async with heard.database.write() as tx:
        await lease.confirm_leases(tx, 1000.0, [claim])
        await robots.load(tx, heard.fleet, heard.clock.now_s(), 15.0, prolong=True)
    heard.says("one")  # that it is idle, before its outcome goes out
    await heard.all_done()
    assert (await end(heard.database, heard.fleet, claim)).done


@pytest.mark.parametrize("new_database", ["sqlite"], indirect=True)
async def test_a_lease_whose_offer_was_lost_with_the_last_services_ends_at_once(heard, fleet_of):
    async with heard.database.write() as tx:
        await robots.keep(tx, [beat("one")], 1.0)
    await asked(heard.database, "robot-0")
    await take(heard.database, "robot-0", fleet_of("robot-0"))
    async with heard.database.write() as tx:
        await robots.load(tx, heard.fleet, heard.clock.now_s(), 15.0, prolong=True)
    heard.says("one")
    await heard.all_done()
    async with heard.database.read() as connection:
        assert await robots.held_by(connection, ["robot-0"]) == {}
        assert (await connection.execute(select(trial.c.faults))).scalars().all() == [0, 0], "nobody is to blame"
        assert (await connection.execute(select(robot.c.faults_in_a_row))).scalar_one() == 0
        assert "before they offered it" in (await connection.execute(select(attempt.c.reason))).scalar_one()
    assert heard.ready() == ("robot-0",)
