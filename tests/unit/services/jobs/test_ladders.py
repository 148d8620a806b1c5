"""Ladders and the leaderboard on each home: one seed for all rungs, and every trial of a fair seed counted."""

import pytest
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest, TaskName
from api_schemas.ladder import LadderRequest
from api_schemas.success_rate import wilson
from services.database.pages import Asked
from services.database.tables import job, policy, policy_owner
from services.errors import Conflict, NotFound, TooMany
from services.jobs import ladders, leaderboard, robots, submission
from services.jobs.leaderboard import Wanted
from services.jobs.submission import Sender
from tests.unit.services.conftest import beat

A, B, C = ("a" * 64, "b" * 64, "c" * 64)
PUSH = Wanted(TaskName.PUSH)


@pytest.fixture
async def database(new_database):
    row = {
        "weights_format": "onnx",
        "weights_sha256": A,
        "weights_bytes": 1,
        "graph_sha256": A,
        "manifest": "{}",
        "warnings": "[]",
    }
    async with new_database.write() as tx:
        for digest, name, owner in ((A, "first", "ann"), (B, "second", "ann"), (C, "third", "bob")):
            await tx.execute(insert(policy).values(row | {"digest": digest, "name": name, "owner": owner, "created_at": "now"}))
            await tx.execute(insert(policy_owner).values(digest=digest, owner=owner, created_at="now"))
        await robots.keep(tx, [beat("robot-0")], 1000.0)
    return new_database


def asked(**more):
    rungs = [{"policy": B, "step": 20}, {"policy": A, "step": 1e6}, {"policy": A, "step": 3}]
    return LadderRequest.model_validate({"name": "l", "task": "push", "trials": 4, "rungs": rungs} | more)


async def send(database, request, sender=Sender("ann", sees_only="ann")):
    async with database.write() as tx:
        return await ladders.submit(tx, 1000.0, request, sender)


async def test_all_rungs_try_the_same_goals_and_stand_by_step(database):
    ladder_id, new = await send(database, asked())
    async with database.read() as connection:
        shown = await ladders.show(connection, ladder_id, "ann")
        jobs = (await connection.execute(select(job))).all()
    assert new and shown.seed_drawn_by_server
    assert [(rung.step, rung.policy) for rung in shown.rungs] == [(3, A), (20, B), (1e6, A)]
    assert {row.seed for row in jobs} == {shown.seed}
    assert all(row.seed_drawn_by_server and row.trials == 4 for row in jobs)
    assert not shown.is_over and shown.rungs[0].interval_80 is shown.rungs[0].interval_95 is None


async def test_a_seed_that_was_asked_for_is_taken_and_said(database):
    ladder_id, _ = await send(database, asked(seed=9))
    async with database.read() as connection:
        shown = await ladders.show(connection, ladder_id, None)
    assert (shown.seed, shown.seed_drawn_by_server) == (9, False)


async def test_a_ladder_comes_in_whole_or_not_at_all(database):
    with pytest.raises(NotFound, match="No policy has the digest c"):
        await send(database, asked(rungs=[{"policy": A, "step": 1}, {"policy": C, "step": 2}]))
    with pytest.raises(TooMany, match="may have 2"):
        await send(database, asked(), Sender("ann", sees_only="ann", may_queue=2))
    async with database.read() as connection:
        assert (await connection.execute(select(job.c.number))).all() == []
        assert (await ladders.lines(connection, None, Asked(5))).entries == []


async def test_the_same_key_is_the_same_ladder(database):
    sender = Sender("ann", "key", "ann")
    first = await send(database, asked(), sender)
    assert await send(database, asked(), sender) == (first[0], False)
    with pytest.raises(Conflict, match="was used for ladder"):
        await send(database, asked(trials=5), sender)


async def test_ladders_of_others_are_not_there(database):
    ladder_id, _ = await send(database, asked())
    async with database.read() as connection:
        with pytest.raises(NotFound, match="no ladder"):
            await ladders.show(connection, ladder_id, "bob")
        (line,) = (await ladders.lines(connection, "ann", Asked(5))).entries
        assert (line.rungs, line.trials, line.trials_done, line.task) == (3, 12, 0, "push")
        assert (await ladders.lines(connection, "bob", Asked(5))).entries == []


async def tried(database, digest, done, successes, state="succeeded", seed=None, **more):
    async with database.write() as tx:
        wish = JobRequest.model_validate({"policy": digest, "task": "push", "trials": 40, "seed": seed} | more)
        job_id, _ = await submission.submit(tx, 1000.0, wish, Sender("ann"))
        counts = {"trials_done": done, "successes": successes, "state": state}
        await tx.execute(update(job).where(job.c.job_id == job_id).values(counts))


async def test_the_board_pools_every_trial_of_a_fair_seed_and_no_other(database):
    await tried(database, A, 40, 30)
    await tried(database, A, 10, 0, state="cancelled")
    await tried(database, A, 40, 40, seed=5)  # who chose the goals may have chosen easy ones
    await tried(database, A, 40, 40, object="sphere")
    await tried(database, B, 3, 3, state="running")
    await tried(database, C, 40, 36)
    async with database.read() as connection:
        shown = await leaderboard.board(connection, PUSH, None)
        found = await leaderboard.contests(connection)
    rows = shown.rows
    assert shown.policies == 3
    assert [(row.policy, row.trials, row.successes, row.jobs) for row in rows] == [(C, 40, 36, 1), (B, 3, 3, 1), (A, 80, 30, 2)]
    assert rows[1].interval_80 == wilson(3, 3, 0.80)
    assert rows[1].interval_95 == wilson(3, 3, 0.95), "three of three are less than 36 of 40"
    assert [(each.object, each.policies) for each in found] == [("cube", 3), ("sphere", 1)]


async def test_who_looks_at_the_seed_and_cancels_has_all_trials_counted(database):
    await tried(database, A, 0, 0, state="cancelled")
    await tried(database, B, 0, 0, state="queued")
    await tried(database, C, 7, 7, state="failed")  # by the platform
    async with database.read() as connection:
        rows = (await leaderboard.board(connection, PUSH, None)).rows
    assert [(row.policy, row.trials, row.successes) for row in rows] == [(C, 7, 7), (A, 40, 0)]


async def test_rungs_do_not_count(database):
    await send(database, asked())
    async with database.write() as tx:
        await tx.execute(update(job).values(trials_done=4, successes=4, state="succeeded"))
    async with database.read() as connection:
        assert (await leaderboard.board(connection, PUSH, None)).policies == 0
        assert await leaderboard.contests(connection) == ()


async def test_who_may_not_see_a_policy_sees_its_digest_alone(database):
    await tried(database, A, 40, 30)
    await tried(database, C, 40, 36)
    async with database.read() as connection:
        rows = (await leaderboard.board(connection, PUSH, "bob")).rows
    assert [(row.policy_name, row.owner, row.policy) for row in rows] == [("third", "bob", C), (None, None, A)]
