"""Users take turns at the robots, whoever came first and however much he asked for."""

import itertools

import pytest
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest
from api_schemas.trial import TrialState
from services.database.tables import job, policy, trial
from services.dispatcher.finding import find_trial
from services.jobs import robots
from services.jobs.position import User, mean_s, trials_ahead
from services.jobs.submission import Sender, submit
from services.jobs.views import show_jobs
from tests.unit.services.conftest import beat, leased_to
from tests.unit.services.dispatcher.conftest import POLICY

ROBOTS = ("a", "b", "c", "d")


@pytest.fixture
def farm(new_database, fleet_of):
    """Queue trials, and have one robot after the other take them: (queue, take)."""
    clock, seeds = itertools.count(1000), itertools.count()
    fleet = fleet_of(*ROBOTS, now_s=1000.0)
    for member in fleet.members.values():
        member.seen_s = 1e9

    async def queue(owner, *trials, priority="normal"):
        async with new_database.write() as tx:
            if (await tx.execute(policy.select())).first() is None:
                await tx.execute(insert(policy).values(POLICY))
            for count in trials:
                request = JobRequest(policy="d" * 64, task="push", trials=count, seed=next(seeds), priority=priority)
                await submit(tx, 1.0, request, Sender(owner))

    async def take(robot, *, limit=None, ends=True, whole=False):
        """The owner of the trial that the robot gets; the trial is over when this returns, unless ``ends`` is false."""
        now_s = float(next(clock))
        async with new_database.write() as tx:
            found = await find_trial(tx, robot, fleet.seen(now_s), limit)
            if found is None:
                return None
            claim = await leased_to(tx, now_s, found[0], robot, departure=found[1], lease_s=15.0)
            if ends:
                done = update(trial).where(trial.c.trial_id == claim.trial_id)
                await tx.execute(done.values(state=TrialState.DONE))
        return found[0] if whole else found[0].owner

    return queue, take


async def test_a_small_user_behind_a_flood_waits_at_most_twice_his_fair_time(farm):
    queue, take = farm
    await queue("flood", 400, 400)
    first = [await take(robot) for robot in ROBOTS * 5]
    assert first == ["flood"] * 20
    await queue("small", 40)
    owners = [await take(robot) for robot in ROBOTS * 40]
    # With half of the robots to himself his 40 trials would be over after 80.
    assert owners.count("small") == 40
    last = max(number for number, owner in enumerate(owners) if owner == "small")
    assert last < 160
    assert last <= 84
    assert owners[last + 1 :] == ["flood"] * (len(owners) - last - 1)


async def test_users_take_turns_at_every_robot_also_where_one_is_quick_and_the_others_pile_up(farm):
    queue, take = farm
    await queue("flood", 400)
    await queue("small", 20)
    took = {robot: [] for robot in ROBOTS}
    for robot in ("a" * 8 + "bcd") * 10:
        took[robot].append(await take(robot))
    assert {robot: owners.count("small") for robot, owners in took.items()} == dict.fromkeys(ROBOTS, 5)
    assert max(number for number, owner in enumerate(took["a"]) if owner == "small") <= 12


async def test_three_users_get_a_third_each_whatever_the_order_and_size_of_their_jobs(farm):
    queue, take = farm
    await queue("ann", 100, 3)
    await queue("bea", 12, 12, 12, 12)
    await queue("cyd", *[1] * 48)
    owners = [await take(robot) for robot in ROBOTS * 12]
    counts = {owner: owners.count(owner) for owner in ("ann", "bea", "cyd")}
    assert all(abs(count - 16) <= 1 for count in counts.values()), counts


async def test_nobody_has_more_trials_running_than_he_may(farm):
    queue, take = farm
    await queue("ann", 40)
    taken = [await take(robot, limit=2, ends=False) for robot in ROBOTS]
    assert taken == ["ann", "ann", None, None]
    await queue("bea", 1)
    assert [await take(robot, limit=2, ends=False) for robot in "cd"] == ["bea", None]
    assert await take("d", limit=3, ends=False) == "ann"


async def test_a_robot_has_one_lease_whoever_writes_it(farm, new_database, fleet_of):
    queue, take = farm
    await queue("ann", 40)
    assert await take("a", ends=False) == "ann"
    # Another dispatcher that has not heard of it finds the next trial for the robot and cannot write its lease.
    async with new_database.write() as tx:
        found = await find_trial(tx, "a", fleet_of(*ROBOTS).seen(1000.0))
        assert await leased_to(tx, 1000.0, found[0], "a", departure=None, lease_s=15.0) is None


async def test_a_robot_that_was_drained_elsewhere_gets_no_lease_from_who_has_not_heard_of_it(farm, new_database, fleet_of):
    queue, _ = farm
    await queue("ann", 40)
    async with new_database.write() as tx:
        await robots.keep(tx, [beat("a")], 1000.0)
    for drain in (True, False):
        async with new_database.write() as tx:
            await robots.wish_drain(tx, "a", drain=drain)
        async with new_database.write() as tx:
            found = await find_trial(tx, "a", fleet_of(*ROBOTS).seen(1000.0))
            claim = await leased_to(tx, 1000.0, found[0], "a", departure=None, lease_s=15.0)
        assert (claim is None) == drain


async def test_users_take_turns_within_a_priority_and_the_more_pressing_goes_first(farm):
    queue, take = farm
    await queue("patient", 4, priority="low")
    await queue("ann", 40)
    await queue("bea", 8)
    assert {await take(robot) for robot in ROBOTS} == {"ann", "bea"}
    await queue("operator", 8, priority="high")
    await queue("second", 8, priority="high")
    owners = [await take(robot) for robot in ROBOTS * 4]
    assert sorted(owners) == ["operator"] * 8 + ["second"] * 8
    assert all(abs(owners[:each].count("operator") - each / 2) <= 2 for each in range(4, 17, 4)), owners
    owners = [await take(robot) for robot in ROBOTS * 12]
    assert owners.index("patient") >= 44 - len(ROBOTS)
    assert [owners.count(who) for who in ("ann", "bea", "patient")] == [38, 6, 4]


async def test_one_who_may_have_no_more_trials_running_keeps_no_lesser_priority_waiting(farm):
    queue, take = farm
    await queue("operator", 8, priority="high")
    await queue("ann", 8)
    assert [await take(robot, limit=1, ends=False) for robot in "abc"] == ["operator", "ann", None]


async def test_what_is_more_pressing_is_ahead_of_a_job_and_what_is_less_is_not(farm, new_database, fleet_of):
    queue, _ = farm
    await queue("ann", 10, priority="low")
    await queue("ann", 5)
    await queue("bea", 7)
    await queue("operator", 3, priority="high")
    async with new_database.read() as connection:
        rows = (await connection.execute(select(job).order_by(job.c.number))).all()
        shown = await show_jobs(connection, rows, fleet_of(*ROBOTS), 1000.0)
    assert [(each.priority, each.queue_position) for each in shown] == [
        ("low", 5 + 7 + 3 + 1),
        ("normal", 3 + 1),
        ("normal", 3 + 1),
        ("high", 1),
    ]
    assert shown[0].waiting_because == "15 trials are ahead"


async def test_the_position_that_a_job_shows_is_where_its_first_trial_is_taken(farm, new_database, fleet_of):
    queue, take = farm
    await queue("flood", 40, 40)
    await queue("ann", 10, 4)
    await queue("bea", 4)
    async with new_database.read() as connection:
        rows = (await connection.execute(select(job).order_by(job.c.number))).all()
        shown = await show_jobs(connection, rows, fleet_of(*ROBOTS), 1000.0)
    positions = [each.queue_position for each in shown]
    assert positions == [1, 40 + 14 + 4 + 1, 1, 10 + 10 + 4 + 1, 1]
    taken = [await take(robot, whole=True) for robot in ROBOTS * 18]
    firsts = [1 + next(n for n, found in enumerate(taken) if found.job_id == each.job_id) for each in shown]
    # A turn is at each robot, and a robot's own trial may come a little sooner or later than the robots' average.
    assert all(abs(first - said) <= 2 * len(ROBOTS) for first, said in zip(firsts, positions, strict=True)), firsts
    assert shown[0].estimated_wait_s is None


def test_how_long_a_job_waits_is_what_is_ahead_at_the_pace_of_the_latest_trials():
    spans = [("2026-01-01T00:00:00.000Z", "2026-01-01T00:00:10.000Z"), ("2026-01-01T00:00:59Z", "2026-01-01T00:01:19Z")]
    assert mean_s(spans) == 15
    assert mean_s([]) is None
    users = [User("ann", 5, 0, 10.0), User("bea", 100, 2, 20.0), User("cyd", 1, 0, 5.0)]
    # Eve was never served, so that she comes before all; three trials on, each of the others had as many turns as they can use.
    assert trials_ahead(0, "eve", users) == 0
    assert trials_ahead(3, "eve", users) == 3 + 3 + 3 + 1
    assert trials_ahead(0, "bea", users) == 1 + 1
