"""What the database keeps of robots, and who of them goes out of service by himself."""

import asyncio

import pytest
from sqlalchemy import insert, select

from api_schemas.robot import RobotState
from services.database.tables import robot
from services.errors import Conflict, NotFound
from services.jobs import robots
from services.jobs.claim import Claim
from services.jobs.fleet import Fleet
from services.jobs.robots import FAULTS_IN_A_ROW
from services.jobs.views import show_robot
from tests.unit.services.conftest import beat
from tests.unit.services.jobs.test_pinning import asked, take

NOW_S = 1000.0


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(robot).values(robot="a", drain=False, first_seen_at="now"))
    return new_database


async def fail(database, times):
    for number in range(times):
        async with database.write() as tx:
            await robots.count_fault(tx, "a", f"reason {number}")


async def shown(database, fleet):
    async with database.read() as connection:
        await robots.refresh(connection, fleet)
    return show_robot(fleet.member("a"), NOW_S)


class WishedMeanwhile:
    """A connection; when it has read, an operator drains the robot before anything else is done."""

    def __init__(self, connection, fleet):
        self.connection, self.fleet = connection, fleet

    async def execute(self, statement):
        """What was there before."""
        found = await self.connection.execute(statement)
        self.fleet.wishes += 1
        self.fleet.member("a").drain = True
        return found


async def test_a_wish_is_not_undone_by_what_was_read_before_it(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    async with database.read() as connection:
        await robots.refresh(WishedMeanwhile(connection, fleet), fleet)
        assert fleet.member("a").drain
        await robots.refresh(connection, fleet)
        assert not fleet.member("a").drain, "what was read after it counts"


async def test_five_faults_in_a_row_take_a_robot_out_of_service_until_an_operator_resumes_it(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    await fail(database, FAULTS_IN_A_ROW - 1)
    assert (await shown(database, fleet)).state == RobotState.IDLE
    await fail(database, 2)
    out = await shown(database, fleet)
    assert out.state == RobotState.OUT_OF_SERVICE
    assert out.reason == "5 attempts in a row failed on it, the last because: reason 0; 'trifarm robots resume a' tries again"
    assert fleet.seen(NOW_S).ready == ()
    assert fleet.healthy(NOW_S) == frozenset()
    async with database.write() as tx:
        await robots.wish_drain(tx, "a", drain=True)
    assert (await shown(database, fleet)).state == RobotState.OUT_OF_SERVICE
    async with database.write() as tx:
        await robots.wish_drain(tx, "a", drain=False)
    assert (await shown(database, fleet)).state == RobotState.IDLE
    await fail(database, FAULTS_IN_A_ROW - 1)
    assert (await shown(database, fleet)).state == RobotState.IDLE


async def test_an_accepted_outcome_between_faults_counts_and_begins_anew(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    for _ in range(3):
        await fail(database, FAULTS_IN_A_ROW - 1)
        async with database.write() as tx:
            await robots.count_done(tx, "a")
    assert (await shown(database, fleet)).state == RobotState.IDLE
    assert (await shown(database, fleet)).trials_done == 3


async def test_a_process_is_new_once_also_for_several_who_hear_it_at_the_same_time(new_database):
    async def hear(instance):
        async with new_database.write() as tx:
            return bool(await robots.keep(tx, [beat("b").model_copy(update={"instance": instance})], NOW_S))

    assert sorted(await asyncio.gather(*(hear("one") for _ in range(4)))) == [False, False, False, True]
    assert sorted(await asyncio.gather(*(hear("two") for _ in range(4)))) == [False, False, False, True]
    async with new_database.read() as connection:
        assert (await connection.execute(select(robot.c.instance))).scalars().all() == ["two"]


async def test_a_robot_that_was_forgotten_is_gone_everywhere_and_may_join_again(database, fleet_of):
    fleet = fleet_of("b")
    async with database.write() as tx:
        await robots.refresh(tx, fleet)
        assert set(fleet.members) == {"a", "b"}, "b is there; it will be written down"
        await robots.forget(tx, "a")
        await robots.refresh(tx, fleet)
        assert set(fleet.members) == {"b"}
        with pytest.raises(NotFound, match="No robot named a ever joined"):
            await robots.forget(tx, "a")
        assert await robots.keep(tx, [beat("a")], NOW_S)


async def test_a_robot_with_a_lease_is_not_forgotten(database, fleet_of):
    await asked(database, "a")
    claim = await take(database, "a", fleet_of("a"))
    async with database.write() as tx:
        with pytest.raises(Conflict, match=f"a has a lease of trial {claim.trial_id}"):
            await robots.forget(tx, "a")


async def test_what_others_wrote_is_in_the_fleet(database):
    async with database.write() as tx:
        await robots.wish_drain(tx, "a", drain=True)
    fleet = Fleet()
    async with database.read() as connection:
        await robots.refresh(connection, fleet)
    assert fleet.member("a").drain


async def test_a_drained_robot_says_when_it_may_be_switched_off(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    async with database.write() as tx:
        await robots.wish_drain(tx, "a", drain=True)
    member = fleet.member("a")
    assert (await shown(database, fleet)).reason == "drained by an operator: runs nothing and may be switched off"
    member.lease = Claim("j1-000", 1, "a")
    assert show_robot(member, NOW_S).reason == "drained by an operator: finishes its trial first"
    assert show_robot(member, NOW_S + 1e6).reason == "drained by an operator"  # and is lost
