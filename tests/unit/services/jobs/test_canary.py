"""Every robot tries the farm's canary while it is idle; one that does too badly goes out of service by itself."""

import itertools

import pytest
from pydantic import ValidationError
from sqlalchemy import insert, select, update

from api_schemas.canary import CanaryRequest
from api_schemas.robot import OutcomeReport, RobotState
from api_schemas.token import Scope, TokenRequest
from api_schemas.trial import FAULT_OF, Outcome, OutcomeKind, TrialState
from services.database.tables import attempt, job, policy, robot, trial
from services.dispatcher.canaries import LOOK_EVERY_S, Canaries
from services.dispatcher.finding import find_trial
from services.errors import NotFound
from services.jobs import canary, completion, robots
from services.jobs.signals import Signals
from services.jobs.views import show_robot
from tests.unit.services.conftest import leased_to
from tests.unit.services.dispatcher.conftest import POLICY

NOW_S = 1000.0
CANARY = CanaryRequest(policy="d" * 64, task="push", trials=10, at_least=0.8, every_s=100.0)
SHA = "e" * 64


class Clock:
    now = NOW_S

    def now_s(self):
        return self.now


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(robot), [{"robot": name, "drain": False, "first_seen_at": "now"} for name in "ab"])
        await canary.choose(tx, NOW_S, CANARY, "operator")
    return new_database


async def run(database, fleet, name, successes):
    """Has the robot run the canary's job that was queued for it, with so many successes."""
    for number in itertools.count():
        async with database.write() as tx:
            found = await find_trial(tx, name, fleet.seen(NOW_S))
            if found is None:
                return
            claim = await leased_to(tx, NOW_S, found[0], name, departure=None, lease_s=15.0)
            await tx.execute(update(attempt).values(log_sha256=SHA))
            kind = OutcomeKind.SUCCEEDED if number < successes else OutcomeKind.FAILED
            outcome = Outcome(kind=kind, fault=FAULT_OF[kind], reason="it ended")
            report = OutcomeReport(robot=name, fence=claim.fence, outcome=outcome, log_sha256=SHA)
            await completion.accept(tx, NOW_S, claim.trial_id, report, log_bytes=1, max_attempts=5)


async def shown(database, fleet, name):
    async with database.read() as connection:
        await robots.refresh(connection, fleet)
    return show_robot(fleet.member(name), NOW_S)


async def jobs(database):
    async with database.read() as connection:
        return (await connection.execute(select(job).order_by(job.c.number))).all()


async def test_idle_robots_try_the_canary_each_in_its_time_and_all_the_same_goals(database):
    clock, signals = Clock(), Signals()
    looking, other = (Canaries(database, clock, signals) for _ in range(2))
    await looking.look(["a"])
    await other.look(["a"])  # another process has the robot idle too
    await other.look(["b"])  # too soon after its last look
    assert [row.robot for row in await jobs(database)] == ["a"]
    clock.now += LOOK_EVERY_S
    await looking.look(["a", "b"])
    clock.now = NOW_S + 99
    await looking.look(["a"])
    rows = await jobs(database)
    assert [(row.robot, row.trials, row.policy, row.owner) for row in rows] == [
        (name, 10, "d" * 64, canary.OWNER) for name in "ab"
    ]
    assert len({row.seed for row in rows}) == 1 and not any(row.seed_drawn_by_server for row in rows)
    clock.now = NOW_S + 100 + LOOK_EVERY_S
    await looking.look(["a"])
    assert [row.robot for row in await jobs(database)] == ["a", "b", "a"]


@pytest.mark.parametrize("successes", [5, 0])
async def test_a_robot_that_leaves_the_band_goes_out_of_service_until_it_is_resumed(database, fleet_of, successes):
    fleet, clock = fleet_of("a", "b", now_s=NOW_S), Clock()
    await Canaries(database, clock, Signals()).look(["a"])
    await run(database, fleet, "a", successes)
    (row,) = await jobs(database)
    assert (row.state, row.successes, row.trials_done) == ("succeeded", successes, 10)
    seen = await shown(database, fleet, "a")
    assert seen.state == RobotState.OUT_OF_SERVICE
    assert seen.reason.startswith(f"its canary (p, push, job {row.job_id}) succeeded in {successes} of 10 trials (80 %: ")
    assert seen.reason.endswith("band of sound robots begins at 80 %; 'trifarm robots resume a' tries again")
    assert (await shown(database, fleet, "b")).state == RobotState.IDLE
    async with database.write() as tx:
        await robots.wish_drain(tx, "a", drain=False)
    assert (await shown(database, fleet, "a")).state == RobotState.IDLE
    clock.now += LOOK_EVERY_S
    await Canaries(database, clock, Signals()).look(["a"])
    assert len(await jobs(database)) == 2, "a robot that is resumed is looked at at once"


async def test_a_robot_within_the_band_serves_on_and_its_report_is_a_jobs(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    await Canaries(database, Clock(), Signals()).look(["a"])
    await run(database, fleet, "a", 7)
    assert (await jobs(database))[0].state == "succeeded"
    assert (await shown(database, fleet, "a")).state == RobotState.IDLE


async def test_jobs_of_users_take_no_robot_out_of_service(database, fleet_of):
    fleet = fleet_of("a", now_s=NOW_S)
    await Canaries(database, Clock(), Signals()).look(["a"])
    async with database.write() as tx:
        await tx.execute(update(job).values(canary_at_least=None))
    await run(database, fleet, "a", 0)
    assert (await shown(database, fleet, "a")).state == RobotState.IDLE


async def test_without_a_canary_nothing_is_queued(database):
    async with database.write() as tx:
        await canary.withdraw(tx)
        assert await canary.queue(tx, NOW_S, "a") is None
    await Canaries(database, Clock(), Signals()).look(["a", "b"])
    assert await jobs(database) == []
    async with database.read() as connection:
        assert (await connection.execute(select(trial).where(trial.c.state == TrialState.QUEUED))).all() == []
        with pytest.raises(NotFound, match="no canary"):
            await canary.chosen(connection)


def test_the_whole_interval_must_lie_below_the_band():
    assert canary.left_band(10, 10, 1.0) is None
    assert canary.left_band(7, 10, 0.8) is None
    assert canary.left_band(0, 1, 0.5) is None, "one trial says nothing"
    assert "succeeded in 0 of 10 trials" in canary.left_band(0, 10, 0.5)


def test_no_user_can_have_the_name_of_the_canarys_owner():
    with pytest.raises(ValidationError, match="owner"):
        TokenRequest(owner=canary.OWNER, scopes=[Scope.SUBMIT])
