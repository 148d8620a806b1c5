"""On each home: a ladder lets goals in by and by, gives rungs up, and shows which can be told apart."""

import pytest
from sqlalchemy import insert, select, update

from api_schemas.ladder import LadderEnds, LadderRequest
from api_schemas.report import read_report
from api_schemas.robot import OutcomeReport
from api_schemas.trial import Fault, Outcome, OutcomeKind, TrialState
from services.database.tables import job, ladder, policy, report, trial
from services.dispatcher.finding import find_trial
from services.jobs import cancellation, completion, ladders, lease, racing, robots
from services.jobs.submission import Sender
from tests.unit.services.conftest import beat, leased_to

DIGESTS = tuple(letter * 64 for letter in "abcd")
ROBOTS = ("r0", "r1")


@pytest.fixture
async def database(new_database):
    kept = {"weights_format": "onnx", "weights_sha256": "a" * 64, "weights_bytes": 1, "graph_sha256": "a" * 64, "manifest": "{}"}
    kept |= {"warnings": "[]", "owner": "ann", "created_at": "now"}
    async with new_database.write() as tx:
        await tx.execute(insert(policy), [kept | {"digest": digest, "name": digest[0]} for digest in DIGESTS])
        for robot in ROBOTS:
            await robots.keep(tx, [beat(robot).model_copy(update={"physics": "real", "physics_digest": "1" * 32})], 1000.0)
    return new_database


async def send(database, trials, ends=None, rungs=4):
    wish = [{"policy": digest, "step": 10 * at, "training_reward": at} for at, digest in enumerate(DIGESTS[:rungs])]
    request = LadderRequest.model_validate({"name": "l", "task": "push", "trials": trials, "rungs": wish, "ends": ends})
    async with database.write() as tx:
        return (await ladders.submit(tx, 1000.0, request, Sender("ann")))[0]


async def rows(database, table=job):
    async with database.read() as connection:
        return (await connection.execute(select(table).order_by(*table.primary_key))).all()


async def show(database, ladder_id):
    async with database.read() as connection:
        return await ladders.show(connection, ladder_id, "ann")


async def move(database):
    async with database.write() as tx:
        return [ended for number in await racing.open_ones(tx) for ended in await racing.move(tx, 1000.0, number, set(ROBOTS))]


async def run(database, fleet_of, ends):
    """Trials on both robots in turn until nothing is queued; those of a policy end as ``ends(name, ordinal)`` says."""
    done = 0
    while True:
        await move(database)
        async with database.write() as tx:
            robot = ROBOTS[done % 2]
            found = await find_trial(tx, robot, fleet_of(robot).seen(1000.0))
            if found is None:
                return done
            claim = await leased_to(tx, 1000.0, found[0], robot, departure=found[1], lease_s=15.0)
            await lease.keep_file(tx, claim.trial_id, claim.fence, "log", "a" * 64)
            succeeded = ends(found[0].policy[0], found[0].ordinal)
            outcome = Outcome(kind=OutcomeKind.SUCCEEDED if succeeded else OutcomeKind.FAILED, fault=Fault.NONE, reason="r")
            told = OutcomeReport(robot=robot, fence=claim.fence, outcome=outcome, log_sha256="a" * 64)
            await completion.accept(tx, 1000.0, claim.trial_id, told, log_bytes=1, max_attempts=5)
        done += 1


def only_c(name, ordinal):
    return name == "c" or (name == "b" and ordinal % 4 == 0)


async def test_worse_rungs_are_given_up_and_the_race_ends_when_the_best_is_known(database, fleet_of):
    ladder_id = await send(database, 60, LadderEnds.KNOWN)
    assert {row.state for row in await rows(database, trial)} == {TrialState.HELD}
    taken = await run(database, fleet_of, only_c)
    shown = await show(database, ladder_id)
    assert [(rung.given_up, rung.letters) for rung in shown.rungs] == [(True, "b"), (True, "b"), (False, "a"), (True, "b")]
    assert shown.best == shown.rungs[2].job_id and shown.is_over and shown.ends is LadderEnds.KNOWN
    counted = [rung.trials_done for rung in shown.rungs]
    assert counted[0] == counted[3] < counted[1] == counted[2] < 30 and taken <= sum(counted) + 2 * len(ROBOTS)
    assert {row.state for row in await rows(database, trial)} == {TrialState.DONE, TrialState.CANCELLED}
    for row, rung in zip([read_report(row.body) for row in await rows(database, report)], sorted(counted), strict=True):
        assert row.intervals == "sequence" and row.trials in counted and rung
    assert await move(database) == [] and not (await rows(database, ladder))[0].is_racing


async def test_halving_leaves_one_rung_with_all_of_its_goals(database, fleet_of):
    ladder_id = await send(database, 8, LadderEnds.HALVING)
    taken = await run(database, fleet_of, lambda name, ordinal: ordinal < 2 * "dabc".index(name))
    shown = await show(database, ladder_id)
    assert [rung.trials_done for rung in shown.rungs] == [2, 4, 8, 2], "of equals the later one stays"
    assert taken <= 16 + len(ROBOTS)
    assert {row.state for row in await rows(database)} == {"succeeded"}


async def test_a_cancelled_rung_does_not_keep_the_others(database, fleet_of):
    ladder_id = await send(database, 6, LadderEnds.KNOWN, rungs=2)
    await move(database)
    async with database.write() as tx:
        await cancellation.cancel(tx, 1000.0, 1)
    await run(database, fleet_of, lambda *_: True)
    shown = await show(database, ladder_id)
    stands = [(rung.state, rung.trials_done, rung.given_up) for rung in shown.rungs]
    assert stands == [("cancelled", 0, False), ("succeeded", 6, False)]


async def test_rungs_say_what_can_be_told_apart_and_whether_success_follows_step_and_reward(database, fleet_of):
    ladder_id = await send(database, 24)
    await run(database, fleet_of, lambda name, ordinal: ordinal < 8 * "abcd".index(name))
    shown = await show(database, ladder_id)
    assert [rung.letters for rung in shown.rungs] == ["c", "bc", "ab", "a"]
    assert shown.best == shown.rungs[3].job_id
    assert [(each.of, each.estimate) for each in shown.correlations] == [("step", 1.0), ("training reward", 1.0)]
    async with database.write() as tx:  # what was done on other physics is compared with nothing
        await tx.execute(update(job).where(job.c.number == 4).values(physics_mixed=True))
    assert [rung.letters for rung in (await show(database, ladder_id)).rungs] == ["b", "ab", "a", None]
