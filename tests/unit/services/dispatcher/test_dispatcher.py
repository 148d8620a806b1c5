"""What the dispatcher does with the queue whenever it looks at it."""

import pytest
from prometheus_client import CollectorRegistry
from sqlalchemy import insert, select, update
from structlog.testing import capture_logs

from api_schemas.policy import LAYOUTS
from api_schemas.robot import RobotState
from api_schemas.trial import TrialState
from services.database.database import AWAY
from services.database.tables import attempt, policy, robot, trial
from services.disk import Disk
from services.dispatcher import dispatcher as dispatcher_module
from services.dispatcher import queue
from services.dispatcher.dispatcher import Dispatcher, Metrics
from services.dispatcher.finding import find_trial
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from services.settings import Settings
from tests.unit.services.conftest import beat, leased_to
from tests.unit.services.dispatcher.conftest import POLICY, add_trials


@pytest.fixture
def dispatcher(database, tmp_path, fleet_of):
    """One with an idle robot a that is offered nothing yet, on no bus."""
    clock = FarmClock.start()
    fleet = fleet_of("a", now_s=clock.now_s())
    fleet.member("a").paused_until_s = clock.now_s() + 60.0
    metrics = Metrics.register(CollectorRegistry())
    disk = Disk(tmp_path, reserve_bytes=0)
    return Dispatcher(Settings(data=tmp_path), database, None, clock, fleet, Signals(), metrics, disk)


async def test_a_trial_that_was_drawn_for_a_robot_that_nobody_knows_goes_to_another(database, dispatcher):
    await add_trials(database, [("ghost", "a"), ("a", "ghost"), ("phantom", "a")])
    async with database.read() as connection:
        assert await queue.drawn_robots(connection) == {"a", "ghost", "phantom"}
    await dispatcher._look(look_at_active=True, leads=True)
    async with database.read() as connection:
        assert await queue.drawn_robots(connection) == {"a"}
        departures = (await connection.execute(select(trial.c.departure).order_by(trial.c.ordinal))).scalars().all()
    assert departures == ["ghost was never seen", None, "phantom was never seen"]
    assert list(dispatcher.fleet.members) == ["a"]


async def test_a_trial_whose_robot_says_that_it_runs_it_is_running_though_its_answer_was_not_noted(database, dispatcher):
    await add_trials(database, [("a",)])
    now_s = dispatcher.clock.now_s()
    async with database.write() as tx:
        row, _ = await find_trial(tx, "a", dispatcher.fleet.seen(now_s))
        claim = await leased_to(tx, now_s, row, "a", departure=None, lease_s=15.0)
    dispatcher.fleet.leased(claim, now_s)

    async def state_after_a_look():
        await dispatcher._look(look_at_active=True, leads=True)
        async with database.read() as connection:
            return (await connection.execute(select(trial.c.state))).scalar_one()

    assert await state_after_a_look() == TrialState.LEASED
    running = beat("a", RobotState.RUNNING).model_copy(update={"trial_id": claim.trial_id, "fence": claim.fence})
    dispatcher.fleet.heard(running, now_s)
    assert await state_after_a_look() == TrialState.RUNNING
    assert dispatcher.fleet.member("a").state(now_s) == RobotState.RUNNING


class Unanswered:
    """A bus on which nobody answers."""

    async def offer(self, _lease, _timeout_s):
        """Nothing came."""


@pytest.mark.parametrize(("leaving", "ends"), [(True, "declined"), (False, "platform_fault")])
async def test_a_robot_that_goes_while_it_is_offered_a_trial_is_not_at_fault(database, dispatcher, leaving, ends):
    await add_trials(database, [("a",)])
    async with database.write() as tx:
        await tx.execute(update(policy).values(manifest=LAYOUTS["pose"].model_dump_json()))
    now_s, dispatcher.bus = dispatcher.clock.now_s(), Unanswered()
    async with database.write() as tx:
        row, _ = await find_trial(tx, "a", dispatcher.fleet.seen(now_s))
        claim = await leased_to(tx, now_s, row, "a", departure=None, lease_s=15.0)
    dispatcher.fleet.heard(beat("a", RobotState.DRAINING).model_copy(update={"leaving": leaving}), now_s)
    await dispatcher._offer(claim, row)
    async with database.read() as connection:
        found = (
            await connection.execute(select(attempt.c.state, trial.c.state).join(trial, attempt.c.trial_id == trial.c.trial_id))
        ).one()
    assert found == (ends, TrialState.QUEUED)


async def test_a_lease_that_the_database_kept_from_being_offered_ends_without_blame(database, dispatcher):
    await add_trials(database, [("a",)])
    now_s = dispatcher.clock.now_s()
    async with database.write() as tx:
        await tx.execute(insert(robot).values(robot="a", drain=False, first_seen_at="now"))
        row, _ = await find_trial(tx, "a", dispatcher.fleet.seen(now_s))
        claim = await leased_to(
            tx, now_s - dispatcher.settings.lease_s, row, "a", departure=None, lease_s=dispatcher.settings.lease_s
        )
        await tx.exec_driver_sql("ALTER TABLE policy RENAME TO gone")
    dispatcher.bus = Unanswered()
    dispatcher.fleet.leased(claim, now_s)
    with pytest.raises(AWAY):
        await dispatcher._offer(claim, row)
    async with database.write() as tx:
        await tx.exec_driver_sql("ALTER TABLE gone RENAME TO policy")
    dispatcher.fleet.heard(beat("a"), now_s)
    await dispatcher._look(look_at_active=True, leads=True)
    async with database.read() as connection:
        assert (await connection.execute(select(trial.c.state, trial.c.faults))).one() == (TrialState.QUEUED, 0)
        assert (await connection.execute(select(robot.c.faults_in_a_row))).scalar_one() == 0


async def test_only_so_many_manifests_are_kept_in_memory(database, dispatcher, monkeypatch):
    monkeypatch.setattr(dispatcher_module, "MANIFESTS_KEPT", 2)
    dispatcher._manifests |= {"one": LAYOUTS["pose"], "two": LAYOUTS["pose"]}
    async with database.write() as tx:
        await tx.execute(update(policy).values(manifest=LAYOUTS["rrc2022-push"].model_dump_json()))
    await dispatcher._policy(POLICY["digest"])
    assert list(dispatcher._manifests) == ["two", POLICY["digest"]]


async def test_a_graph_that_was_converted_again_is_in_the_next_lease(database, dispatcher):
    for graph in ("a" * 64, "b" * 64):
        async with database.write() as tx:
            await tx.execute(update(policy).values(manifest=LAYOUTS["pose"].model_dump_json(), graph_sha256=graph))
        assert await dispatcher._policy(POLICY["digest"]) == (LAYOUTS["pose"], graph)


async def test_a_robot_that_left_is_on_no_list_after_a_minute(database, dispatcher):
    async with database.write() as tx:
        await tx.execute(insert(robot), [{"robot": name, "drain": False, "first_seen_at": "now"} for name in "ab"])
    gone = beat("a", RobotState.DRAINING).model_copy(update={"leaving": True})
    dispatcher.fleet.heard(gone, dispatcher.clock.now_s() - 100.0)
    dispatcher.fleet.token_changed("a", present=False, now_s=dispatcher.clock.now_s() - 100.0)
    await dispatcher._look(look_at_active=True, leads=True)
    await dispatcher._look(look_at_active=True, leads=True)
    async with database.read() as connection:
        assert (await connection.execute(select(robot.c.robot))).scalars().all() == ["b"]
    assert "a" not in dispatcher.fleet.members


async def test_an_error_without_words_is_told_by_its_name(dispatcher):
    with capture_logs() as lines:
        dispatcher._note_away(TimeoutError())
    assert [line["reason"] for line in lines] == ["TimeoutError"]


@pytest.mark.parametrize("looks_at_active", [False, True])
async def test_questions_that_failed_are_tried_again_when_all_is_looked_at(dispatcher, monkeypatch, looks_at_active):
    asked = []

    async def look(_robots, *, also_failed):
        asked.append(also_failed)

    monkeypatch.setattr(dispatcher._judge, "look", look)
    await dispatcher._look(look_at_active=looks_at_active, leads=True)
    assert asked == [looks_at_active]
