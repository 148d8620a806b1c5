import asyncio

import pytest
from sqlalchemy import insert, select, update

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from api_schemas.trial import AttemptState, TrialState
from services.database.tables import attempt, trial
from services.dispatcher import turns
from services.dispatcher.finding import find_trial, pass_over, passed_over
from services.dispatcher.queue import PASSED_OVER_AT_ONCE
from services.jobs.claim import Claim
from services.jobs.fleet import Fleet
from tests.unit.services.dispatcher.conftest import add_trials

NOW_S = 1000.0
ORDERS = [("a", "b", "c"), ("a", "c", "b"), ("a", "b", "c")]


async def add_fault(database, robot, fence=1):
    row = {"trial_id": "j1-000", "fence": fence, "job_number": 1, "robot": robot, "state": AttemptState.PLATFORM_FAULT}
    async with database.write() as tx:
        await tx.execute(insert(attempt).values(row | {"started_at": "now"}))


def fleet_of(*robots, busy=()):
    fleet = Fleet()
    for robot in robots:
        fleet.token_changed(robot, present=True, now_s=NOW_S)
        fleet.heard(Heartbeat(robot=robot, instance="one", pid=1, host="h", state=RobotState.IDLE), NOW_S)
    for robot in busy:
        fleet.leased(Claim("other", 1, robot), NOW_S, accepted=True)
    return fleet


async def found_by(database, robot, fleet, now_s=NOW_S, pass_over_s=0.5):
    """What the robot finds, in the transactions of a dispatcher."""
    async with asyncio.timeout(60):
        seen = fleet.seen(now_s)
        async with database.write() as tx:
            if (found := await find_trial(tx, robot, seen)) is not None:
                return found
            (found, *_) = (await passed_over(tx, seen.ready, seen, pass_over_s)).get(robot, [None])
        if found is None:
            async with database.write() as tx:
                await pass_over(tx, seen)
        return found


async def take(database, robot, fleet, now_s):
    """The number of the trial that the robot gets; the trial leaves the queue."""
    if (found := await found_by(database, robot, fleet, now_s)) is None:
        return None
    async with database.write() as tx:
        await tx.execute(update(trial).where(trial.c.trial_id == found[0].trial_id).values(state=TrialState.DONE))
    return found[0].ordinal


@pytest.mark.parametrize("others", [(), ("b",)])
async def test_a_robot_that_was_lost_meanwhile_gets_nothing_at_once(database, others):
    await add_trials(database, [("a", "b")], fence=1)
    fleet = fleet_of("a", *others)
    fleet.token_changed("a", present=False, now_s=NOW_S)
    assert await found_by(database, "a", fleet) is None


async def test_a_robot_that_is_lost_while_its_trial_is_looked_for_is_not_looked_at_for_ever(database, monkeypatch):
    await add_trials(database, [("a",)], fence=1)
    fleet, ranks = fleet_of("a"), turns.ranks

    async def lost_after(tx, robot):
        found = await ranks(tx, robot)
        fleet.token_changed(robot, present=False, now_s=NOW_S)  # what the bus says while the database answers
        return found

    monkeypatch.setattr(turns, "ranks", lost_after)
    await found_by(database, "a", fleet)  # whatever it finds: an offer that nobody answers ends the lease


async def test_a_trial_that_its_first_choice_failed_goes_to_another_first(database):
    await add_trials(database, [("a", "b")], fence=1)
    await add_fault(database, "a")
    fleet = fleet_of("a", "b")
    assert await found_by(database, "a", fleet) is None
    row, departure = await found_by(database, "b", fleet)
    assert (row.ordinal, departure) == (0, "a refused or failed an earlier attempt")


async def test_a_trial_that_all_have_failed_goes_to_its_first_choice_again(database):
    await add_trials(database, [("a", "b")], fence=2)
    await add_fault(database, "a")
    await add_fault(database, "b", fence=2)
    row, _ = await found_by(database, "a", fleet_of("a", "b"))
    assert row.ordinal == 0


async def test_all_trials_of_a_busy_robot_wait_the_same_time_and_go_to_the_next_of_their_orders(database):
    await add_trials(database, ORDERS)
    fleet = fleet_of("a", "b", "c", busy="a")
    assert [await take(database, robot, fleet, NOW_S) for robot in "bc"] == [None, None]
    assert [await take(database, robot, fleet, NOW_S + 0.4) for robot in "bc"] == [None, None]
    # c has only the trial that names it next; b has two.
    assert [await take(database, robot, fleet, NOW_S + 0.5) for robot in "ccbb"] == [1, None, 0, 2]


async def test_a_passed_over_trial_does_not_wait_for_a_next_robot_that_is_busy_too(database):
    await add_trials(database, ORDERS[:1])
    fleet = fleet_of("a", "b", "c", busy="ab")
    assert await take(database, "c", fleet, NOW_S) is None
    assert await take(database, "c", fleet, NOW_S + 0.5) == 0


async def test_trials_of_an_idle_robot_are_not_passed_over(database):
    await add_trials(database, ORDERS)
    fleet = fleet_of("a", "b", busy=())
    assert await take(database, "b", fleet, NOW_S) is None
    assert await take(database, "b", fleet, NOW_S + 5) is None


async def test_only_the_oldest_trials_are_looked_at_when_many_wait(database):
    await add_trials(database, ORDERS[:1] * (PASSED_OVER_AT_ONCE + 5))
    await found_by(database, "b", fleet_of("a", "b", busy="a"))
    async with database.read() as connection:
        since = (await connection.execute(select(trial.c.passed_over_s).order_by(trial.c.ordinal))).scalars().all()
    assert since == [NOW_S] * PASSED_OVER_AT_ONCE + [None] * 5
