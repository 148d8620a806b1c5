"""On each home: the leaderboard puts together what was done on one physics, says on which, and reads little for it."""

import re

import pytest
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest, TaskName
from api_schemas.robot import OutcomeReport
from api_schemas.trial import Fault, Outcome, OutcomeKind
from services.database.tables import job, physics, policy, trial
from services.dispatcher.finding import find_trial
from services.errors import NotFound
from services.jobs import completion, leaderboard, lease, robots, submission
from services.jobs.leaderboard import Wanted
from services.jobs.submission import Sender
from tests.unit.services.conftest import beat, leased_to
from tests.unit.services.reading import Reading

A, B = "a" * 64, "b" * 64
PUSH = Wanted(TaskName.PUSH)
REAL = {"physics": "real", "physics_digest": "1" * 32}
OTHER_SEED = {"physics": "real", "physics_digest": "2" * 32}


@pytest.fixture
async def database(new_database):
    kept = {"weights_format": "onnx", "weights_sha256": A, "weights_bytes": 1, "graph_sha256": A, "manifest": "{}"}
    kept |= {"warnings": "[]", "owner": "ann", "created_at": "now"}
    async with new_database.write() as tx:
        await tx.execute(insert(policy), [kept | {"digest": digest, "name": digest[0]} for digest in (A, B)])
    return new_database


async def join(database, robot, told, now_s=1000.0, instance="one"):
    async with database.write() as tx:
        return await robots.keep(tx, [beat(robot).model_copy(update=told | {"instance": instance})], now_s)


async def queued(database, digest=A, trials=2):
    async with database.write() as tx:
        wish = JobRequest(policy=digest, task=TaskName.PUSH, trials=trials)
        return (await submission.submit(tx, 1000.0, wish, Sender("ann")))[0]


async def run(database, fleet_of, robot, kind=OutcomeKind.SUCCEEDED):
    """One trial on the robot, from its lease to its accepted outcome."""
    async with database.write() as tx:
        row, departure = await find_trial(tx, robot, fleet_of(robot).seen(1000.0))
        claim = await leased_to(tx, 1000.0, row, robot, departure=departure, lease_s=15.0)
        await lease.keep_file(tx, claim.trial_id, claim.fence, "log", A)
        outcome = Outcome(kind=kind, fault=Fault.NONE, reason="r")
        report = OutcomeReport(robot=robot, fence=claim.fence, outcome=outcome, log_sha256=A)
        await completion.accept(tx, 1000.0, claim.trial_id, report, log_bytes=1, max_attempts=5)


async def board(database, wanted=PUSH):
    async with database.read() as connection:
        return await leaderboard.board(connection, wanted, None)


def pooled(shown):
    return [(row.policy, row.jobs, row.successes, row.trials) for row in shown.rows]


async def test_other_content_or_another_farm_seed_under_the_same_name_makes_another_board(database, fleet_of):
    await join(database, "r", REAL)
    for _ in range(2):
        await queued(database)
        await run(database, fleet_of, "r")
        await run(database, fleet_of, "r")
    await join(database, "r", OTHER_SEED, now_s=2000.0, instance="two")
    await queued(database)
    await run(database, fleet_of, "r", OutcomeKind.FAILED)
    now, before = await board(database), await board(database, Wanted(TaskName.PUSH, physics=1))
    assert (now.physics.name, now.physics.number, now.physics.is_now) == ("real", 2, True)
    assert (before.physics.name, before.physics.number, before.physics.is_now) == ("real", 1, False)
    assert pooled(now) == [(A, 1, 0, 1)]
    assert pooled(before) == [(A, 2, 4, 4)]
    async with database.read() as connection:
        found = await leaderboard.contests(connection)
    assert [(each.physics.number, each.policies) for each in found] == [(2, 1), (1, 1)], "now's comes first"


async def test_what_a_farm_had_before_is_its_physics_again_when_it_comes_back(database, fleet_of):
    for place, told in enumerate((REAL, OTHER_SEED, REAL)):
        await join(database, "r", told, now_s=1000.0 + place, instance=str(place))
    assert not await join(database, "r", REAL, now_s=1005.0, instance="2"), "it is known already"
    await queued(database)
    await run(database, fleet_of, "r")
    assert (await board(database)).physics.number == 1
    async with database.read() as connection:
        assert len((await connection.execute(select(physics))).all()) == 2


async def test_a_job_that_was_done_on_two_physics_counts_on_neither_board(database, fleet_of):
    await join(database, "r", REAL)
    await queued(database, trials=3)
    await queued(database, B)
    await run(database, fleet_of, "r")
    await join(database, "r", OTHER_SEED, now_s=2000.0, instance="two")
    await run(database, fleet_of, "r")
    await run(database, fleet_of, "r")
    await run(database, fleet_of, "r")  # of the job that was only queued before: all of it is done on the new
    assert pooled(await board(database)) == [(B, 1, 1, 1)]
    assert pooled(await board(database, Wanted(TaskName.PUSH, physics=1))) == []


async def test_a_job_that_nobody_tried_counts_on_the_physics_that_it_was_queued_on(database):
    await join(database, "r", REAL)
    job_id = await queued(database, trials=7)
    await join(database, "r", OTHER_SEED, now_s=2000.0, instance="two")
    async with database.write() as tx:
        await tx.execute(update(job).where(job.c.job_id == job_id).values(state="cancelled"))
    assert pooled(await board(database)) == []
    assert pooled(await board(database, Wanted(TaskName.PUSH, physics=1))) == [(A, 1, 0, 7)]


async def test_physics_that_only_has_a_name_counts_if_nothing_can_be_behind_it(database, fleet_of):
    assert (await board(database)).physics is None
    await join(database, "r", {"physics": "real"})
    await queued(database, trials=1)
    await run(database, fleet_of, "r")
    shown = await board(database)
    assert (shown.physics, shown.rows) == (None, ())
    await join(database, "r", {"physics": "nominal"}, instance="two")
    await queued(database, trials=1)
    await run(database, fleet_of, "r")
    assert pooled(await board(database)) == [(A, 1, 1, 1)]


async def test_physics_that_never_was_is_said(database):
    with pytest.raises(NotFound, match="never had physics number 9"):
        await board(database, Wanted(TaskName.PUSH, physics=9))


async def many(database, jobs, trials):
    """Jobs of two policies in turn, done, each with its trials."""
    async with database.write() as tx:
        for place in range(jobs):
            wish = JobRequest(policy=(A, B)[place % 2], task=TaskName.PUSH, trials=trials)
            await submission.submit(tx, 1000.0, wish, Sender("ann"))
        await tx.execute(update(job).values(state="succeeded", trials_done=trials, successes=trials))
        await tx.execute(update(trial).values(state="done"))


async def test_a_view_reads_the_counts_of_jobs_and_no_trial_however_many_there_are(database):
    await join(database, "r", REAL)
    reads = []
    for jobs, trials in ((4, 1), (36, 50)):
        await many(database, jobs, trials)
        with Reading(database) as reading:
            shown = await board(database)
        reads.append(len(reading.asked))
        assert not any("trial" in re.findall(r"(?:FROM|JOIN) (\w+)", asked) for asked, _ in reading.asked)
    assert reads == [3, 3], (
        "whatever is there: which physics, one row for each policy, how the trials of jobs that are over ended"
    )
    assert [(row.jobs, row.trials) for row in shown.rows] == [(20, 20 * 50), (20, 20 * 50)]


async def test_a_view_looks_at_the_jobs_of_its_contest_alone(database):
    if database.is_shared:
        pytest.skip("how PostgreSQL goes about it depends on what it has counted of the rows")
    await join(database, "r", REAL)
    await many(database, 4, 1)
    with Reading(database) as reading:
        await board(database)
    async with database.read() as connection:
        plans = [(await connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {a}", p)).all() for a, p in reading.asked]
    steps = [step.detail for plan in plans for step in plan]
    found = "SEARCH job USING INDEX ix_job_board (task=? AND object=? AND object_scale=? AND physics=?"
    assert any(step.startswith(found) for step in steps), steps
    assert not any(step.startswith("SCAN job") for step in steps), steps


async def test_two_forms_of_the_scene_are_never_pooled(database, fleet_of):
    """A rolling update in the middle of a job marks it mixed; what is queued afterwards is of the new form alone."""
    told = REAL | {"form": "0.1.0"}
    await join(database, "robot-0", told)
    before = await queued(database)
    await run(database, fleet_of, "robot-0")
    await run(database, fleet_of, "robot-0")
    between = await queued(database)
    await run(database, fleet_of, "robot-0")
    await join(database, "robot-0", REAL | {"form": "0.2.0-0123456789ab"}, now_s=2000.0, instance="two")
    await run(database, fleet_of, "robot-0")
    await queued(database)
    await run(database, fleet_of, "robot-0")
    await run(database, fleet_of, "robot-0")
    now, first = await board(database), await board(database, Wanted(TaskName.PUSH, physics=1))
    assert (now.physics.form, now.rows[0].trials, now.rows[0].jobs) == ("0.2.0-0123456789ab", 2, 1)
    assert (first.physics.form, first.rows[0].trials, first.rows[0].jobs) == ("0.1.0", 2, 1)
    async with database.read() as connection:
        rows = {row.job_id: row.physics_mixed for row in await connection.execute(select(job.c.job_id, job.c.physics_mixed))}
    assert (rows[before], rows[between]) == (False, True)
