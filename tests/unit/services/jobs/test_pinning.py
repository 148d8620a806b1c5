"""Identifications on one robot, from their submission to the robot that gets their trials."""

import json

import pytest
from sqlalchemy import insert, select

from api_schemas.excitation import ExcitationName, IdentificationRequest
from api_schemas.robot import OutcomeReport, RobotState
from api_schemas.trial import Fault, Outcome, OutcomeKind
from services.database.tables import job, robot, trial
from services.dispatcher import queue
from services.dispatcher.finding import find_trial
from services.errors import Conflict, NotFound, Refused
from services.jobs import completion, lease, lists, views
from services.jobs.submission import Sender, identify
from tests.unit.services.conftest import beat, leased_to

NOW_S = 1000.0
ANN = Sender("ann")


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(robot), [{"robot": name, "drain": False, "first_seen_at": "now"} for name in "abc"])
    return new_database


async def asked(database, name="any", excitations=("chirps", "hold_poses"), sender=ANN, **more):
    request = IdentificationRequest(robot=name, excitations=excitations, **more)
    async with database.write() as tx:
        return await identify(tx, NOW_S, request, sender)


async def test_a_robot_that_came_a_moment_ago_and_is_not_written_down_yet_can_be_asked_for(database):
    request = IdentificationRequest(robot="new", excitations=("chirps",))
    async with database.write() as tx:
        with pytest.raises(NotFound):
            await identify(tx, NOW_S, request, ANN, ["other"])
        assert (await identify(tx, NOW_S, request, ANN, ["new"]))[1]


async def take(database, name, fleet):
    """The claim of the trial that the robot gets, as the dispatcher gives it; None when there is none."""
    async with database.write() as tx:
        found = await find_trial(tx, name, fleet.seen(NOW_S))
        if found is None:
            return None
        claim = await leased_to(tx, NOW_S, found[0], name, departure=found[1], lease_s=15.0)
    fleet.leased(claim, NOW_S, accepted=True)
    return claim


async def end(database, fleet, claim, kind=OutcomeKind.RECORDED, fault=Fault.NONE):
    report = OutcomeReport(
        robot=claim.robot, fence=claim.fence, outcome=Outcome(kind=kind, fault=fault, reason="r"), log_sha256="0" * 64
    )
    async with database.write() as tx:
        await lease.keep_file(tx, claim.trial_id, claim.fence, "log", "0" * 64)
        ending = await completion.accept(tx, NOW_S, claim.trial_id, report, log_bytes=1, max_attempts=5)
    fleet.freed(claim, done=ending.done)
    return ending


async def give_back(database, fleet, claim):
    async with database.write() as tx:
        await completion.decline(tx, NOW_S, claim, "not now")
    fleet.freed(claim, done=False)


async def shown(database, job_id, fleet):
    async with database.read() as connection:
        row = await views.job_row(connection, job_id, None)
        (one,) = await views.show_jobs(connection, [row], fleet, NOW_S)
        return one, await views.show_trials(connection, row, await lists.trials_of(connection, row.number), fleet, NOW_S)


async def test_each_repeat_runs_the_excitations_in_their_order(database, fleet_of):
    job_id, new = await asked(database, "b", repeats=2, seed=7)
    one, trials = await shown(database, job_id, fleet_of("b"))
    assert new
    assert (one.task, one.trials, one.seed, one.robot, one.policy, one.policy_name) == ("identify", 4, 7, "b", None, None)
    assert [each.excitation for each in trials] == [ExcitationName.CHIRPS, ExcitationName.HOLD_POSES] * 2
    assert len({each.seed for each in trials}) == 4


async def test_the_same_key_makes_one_job_and_another_request_with_it_is_refused(database):
    sender = Sender("ann", "key")
    first, again = await asked(database, "b", sender=sender), await asked(database, "b", sender=sender)
    assert (first[0], again[1]) == (again[0], False)
    with pytest.raises(Conflict, match="with another body"):
        await asked(database, "c", sender=sender)


async def test_a_robot_that_never_joined_is_refused(database):
    with pytest.raises(NotFound, match="No robot named z"):
        await asked(database, "z")


async def test_only_the_named_robot_gets_the_trials_however_long_it_is_busy(database, fleet_of):
    await asked(database, "b")
    fleet = fleet_of("a", "b", "c")
    assert await take(database, "a", fleet) is None
    first = await take(database, "b", fleet)
    async with database.write() as tx:
        await queue.pass_over(tx, ["b"], 0.0, ())
    assert [await take(database, name, fleet) for name in "ac"] == [None, None]
    await end(database, fleet, first)
    assert (await take(database, "b", fleet)).robot == "b"


async def test_the_named_robot_gets_a_trial_again_that_it_failed_or_declined(database, fleet_of):
    await asked(database, "b", ("chirps",))
    fleet = fleet_of("a", "b")
    await end(database, fleet, await take(database, "b", fleet), OutcomeKind.PLATFORM_ERROR, Fault.PLATFORM)
    assert await take(database, "a", fleet) is None
    await give_back(database, fleet, await take(database, "b", fleet))
    assert await take(database, "a", fleet) is None
    assert (await take(database, "b", fleet)).fence == 3


async def test_any_robot_means_the_first_that_takes_a_trial_and_then_no_other(database, fleet_of):
    job_id, _ = await asked(database, excitations=tuple(ExcitationName))
    fleet = fleet_of("a", "b", "c")
    first = await take(database, "b", fleet)
    assert (await shown(database, job_id, fleet))[0].robot == "b"
    assert [await take(database, name, fleet) for name in "ac"] == [None, None]
    for _ in ExcitationName:
        ending = await end(database, fleet, first)
        first = None if ending.job_ended else await take(database, "b", fleet)
    one, trials = await shown(database, job_id, fleet)
    assert one.state == "succeeded"
    assert {each.robot for each in trials} == {"b"}
    assert {each.outcome.kind for each in trials} == {"recorded"}


async def test_a_robot_that_did_nothing_of_the_job_does_not_keep_it(database, fleet_of):
    job_id, _ = await asked(database)
    fleet = fleet_of("a", "b")
    await give_back(database, fleet, await take(database, "a", fleet))
    assert (await shown(database, job_id, fleet))[0].robot is None
    fleet.heard(beat("a", RobotState.OUT_OF_SERVICE), NOW_S)
    claim = await take(database, "b", fleet)
    await end(database, fleet, claim, OutcomeKind.PLATFORM_ERROR, Fault.PLATFORM)
    assert (await shown(database, job_id, fleet))[0].robot is None
    async with database.read() as connection:
        orders = (await connection.execute(select(trial.c.robot_order, trial.c.first_choice))).all()
    assert {(tuple(json.loads(order)), choice) for order, choice in orders} == {((), None)}


async def test_a_robot_that_has_recorded_something_keeps_the_job_through_a_fault(database, fleet_of):
    job_id, _ = await asked(database)
    fleet = fleet_of("a", "b")
    await end(database, fleet, await take(database, "b", fleet))
    await end(database, fleet, await take(database, "b", fleet), OutcomeKind.PLATFORM_ERROR, Fault.PLATFORM)
    assert await take(database, "a", fleet) is None
    one, _ = await shown(database, job_id, fleet)
    assert (one.robot, one.platform_faults) == ("b", 1)
    assert (await take(database, "b", fleet)).fence == 2


async def test_what_waits_for_a_robot_out_of_service_says_so_and_holds_nobody_up(database, fleet_of):
    waiting, _ = await asked(database, "b", tuple(ExcitationName))
    other, _ = await asked(database, "c")
    fleet = fleet_of("a", "b", "c")
    fleet.heard(beat("b", RobotState.OUT_OF_SERVICE, "joint 4 does not follow"), NOW_S)
    one, trials = await shown(database, waiting, fleet)
    assert one.waiting_because == f"{len(ExcitationName)} trials must run on b, which is out of service (joint 4 does not follow)"
    assert trials[0].waiting_because == "it must run on b, which is out of service (joint 4 does not follow)"
    assert (await take(database, "c", fleet)).trial_id == f"{other}-000"
    fleet.token_changed("b", present=False, now_s=NOW_S)
    assert "which has been silent for" in (await shown(database, waiting, fleet))[0].waiting_because
    assert "which has not been seen since" in (await shown(database, waiting, fleet_of("a")))[0].waiting_because


@pytest.mark.parametrize("kind", [OutcomeKind.SUCCEEDED, OutcomeKind.FAILED])
async def test_an_excitation_is_recorded_and_not_judged(database, fleet_of, kind):
    await asked(database, "b")
    fleet = fleet_of("b")
    claim = await take(database, "b", fleet)
    with pytest.raises(Refused, match="can only be recorded"):
        await end(database, fleet, claim, kind)
    async with database.read() as connection:
        assert (await connection.execute(select(job.c.trials_done))).scalar() == 0
