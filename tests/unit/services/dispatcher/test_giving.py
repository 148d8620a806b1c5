"""Giving leases costs what there is to give, however many robots are idle."""

from contextlib import asynccontextmanager

import pytest
from prometheus_client import CollectorRegistry, Histogram
from sqlalchemy import select

from api_schemas.trial import TrialState
from services.database.tables import trial, turn
from services.dispatcher import giving
from services.dispatcher.finding import find_trial
from services.dispatcher.giving import FEW, Giver
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from services.settings import Settings
from tests.unit.services.conftest import leased_to
from tests.unit.services.dispatcher.conftest import add_trials

ROBOTS = tuple(f"robot-{number:02d}" for number in range(40))


class Given:
    """A giver that counts its transactions, and what it offered."""

    def __init__(self, database, fleet, folder, clock):
        self.database, self.fleet, self.clock, self.offers, self.transactions = database, fleet, clock, [], 0
        settings = Settings(data=folder, pass_over_s=0.0)
        claim_s = Histogram("claim", "of the test", registry=CollectorRegistry())
        offer = lambda claim, row: self.offers.append((claim.robot, row.ordinal))  # noqa: E731
        self.giver = Giver(settings, database, clock, fleet, Signals(), self.alone, offer, claim_s)

    @asynccontextmanager
    async def alone(self, **how):
        self.transactions += 1
        async with self.database.write(**how) as tx:
            yield tx

    async def give(self):
        await self.giver.give(self.fleet.seen(self.clock.now_s()))


@pytest.fixture
def given(database, fleet_of, tmp_path, monkeypatch):
    monkeypatch.setattr(giving, "AT_MOST_S", 60.0)
    clock = FarmClock.start()
    return Given(database, fleet_of(*ROBOTS, now_s=clock.now_s()), tmp_path, clock)


async def test_idle_robots_that_nothing_waits_for_cost_no_transaction(database, given):
    assert len(ROBOTS) > FEW
    await add_trials(database, [(robot,) for robot in ROBOTS[10:13]])
    await given.give()
    assert given.offers == [(robot, ordinal) for ordinal, robot in enumerate(ROBOTS[10:13])]
    # One to find out that nothing is left to draw, and one for each lease at most.
    assert given.transactions <= 1 + 3


async def test_leases_of_several_robots_are_written_in_one_transaction_and_offered_after_it(database, given):
    await add_trials(database, [(robot,) for robot in ROBOTS])
    in_transaction, offered_in_it = [], []
    alone, offer = given.giver.alone, given.giver.offer

    @asynccontextmanager
    async def watched(**how):
        async with alone(**how) as tx:
            in_transaction.append(True)
            yield tx
        in_transaction.pop()

    given.giver.alone = watched
    given.giver.offer = lambda claim, row: (offered_in_it.extend(in_transaction), offer(claim, row))
    await given.give()
    assert len(given.offers) == len(ROBOTS)
    assert offered_in_it == []
    assert given.transactions == len(ROBOTS) / giving.AT_ONCE


async def test_trials_without_an_order_are_drawn_and_given_in_the_same_pass(database, given):
    await add_trials(database, [(robot,) for robot in ROBOTS[:3]])
    async with database.write() as tx:
        await tx.execute(trial.update().values(first_choice=None, robot_order="[]"))
    await given.give()
    assert len({robot for robot, _ in given.offers}) == 3
    async with database.read() as connection:
        assert set((await connection.execute(select(trial.c.state))).scalars()) == {TrialState.LEASED}


async def test_what_waited_too_long_for_a_busy_robot_goes_to_the_next_of_its_order(database, given):
    await add_trials(database, [(ROBOTS[0], ROBOTS[7]), (ROBOTS[0], ROBOTS[5])])
    given.fleet.leased(Claim("other", 1, ROBOTS[0]), given.clock.now_s(), accepted=True)
    await given.give()
    assert given.offers == [], "it has just begun to wait"
    await given.give()
    assert sorted(given.offers) == [(ROBOTS[5], 1), (ROBOTS[7], 0)]


async def test_a_pass_that_takes_long_ends_and_the_next_goes_on_behind_its_last_robot(database, given, monkeypatch):
    await add_trials(database, [(robot,) for robot in ROBOTS[:4]])
    monkeypatch.setattr(giving, "AT_MOST_S", -1.0)
    monkeypatch.setattr(giving, "AT_ONCE", 1)
    for number in range(1, 5):
        await given.give()
        assert [robot for robot, _ in given.offers] == list(ROBOTS[:number])


async def test_who_has_a_lease_that_this_dispatcher_has_not_heard_of_costs_no_user_the_turn(database, given):
    await add_trials(database, [(ROBOTS[0],), (ROBOTS[0],)])
    async with database.write() as tx:
        row, _ = await find_trial(tx, ROBOTS[0], given.fleet.seen(given.clock.now_s()))
        await leased_to(tx, 1.0, row, ROBOTS[0], departure=None, lease_s=15.0)
    async with database.read() as connection:
        before = (await connection.execute(select(turn))).all()
    await given.give()  # to its fleet the robot is idle
    async with database.read() as connection:
        assert (await connection.execute(select(turn))).all() == before
    assert given.offers == []


async def test_of_what_was_passed_over_a_user_gets_no_more_than_his_limit(database, given):
    await add_trials(database, [(ROBOTS[0], ROBOTS[7]), (ROBOTS[0], ROBOTS[5])])
    given.giver.settings = given.giver.settings.model_copy(update={"user_trials_at_once": 1})
    given.fleet.leased(Claim("other", 1, ROBOTS[0]), given.clock.now_s(), accepted=True)
    for _ in range(3):
        await given.give()
    assert len(given.offers) == 1
