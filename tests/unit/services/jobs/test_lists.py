"""Lists of jobs: which are found, and that every page of every list comes from an index, in order, at the cost of the first."""

import json
from functools import partial

import pytest
from sqlalchemy import insert, select, text

from api_schemas.job import JobState
from api_schemas.token import Scope, TokenRequest
from services.database.pages import Asked, read_page
from services.database.tables import job, ladder, policy, policy_owner, rung, trial
from services.jobs import ladders, lists
from services.jobs.clock import FarmClock
from services.jobs.lists import JobFilter
from services.policies import owners
from services.tokens import Tokens, new_bearer
from tests.unit.services.reading import Reading

MANY = 3000
OWNERS = ("ann", "bob", "100%_cy")
AT = "2026-01-01T00:00:00Z"
JOB = {"task": "push", "seed": 1, "seed_drawn_by_server": False, "trials": 10, "created_at": AT, "created_s": 0.0}


def rows_of_jobs(count, first=1):
    states = list(JobState)
    for number in range(first, first + count):
        yield JOB | {"number": number, "job_id": f"j{number}", "state": states[number % 5], "owner": OWNERS[number % 3]}


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(job), list(rows_of_jobs(9)))
    return new_database


async def found(database, **chosen):
    async with database.read() as connection:
        return [row.number for row in (await lists.job_page(connection, JobFilter(**chosen), Asked(20))).entries]


async def test_jobs_are_found_by_owner_state_and_text(database):
    assert await found(database) == [9, 8, 7, 6, 5, 4, 3, 2, 1]
    assert await found(database, owner="bob") == [7, 4, 1]
    assert await found(database, state=JobState.QUEUED) == [5]
    assert await found(database, text="%_") == [8, 5, 2], "what a user types is no pattern"
    assert await found(database, text="J3") == [3]
    assert await found(database, text="x") == []


async def test_a_job_that_comes_meanwhile_moves_no_other(database):
    seen, asked = [], Asked(2)
    for number in range(10, 15):
        async with database.read() as connection:
            page = await lists.job_page(connection, JobFilter(), asked)
        seen += [row.number for row in page.entries]
        asked = Asked(2, page.following)
        async with database.write() as tx:
            await tx.execute(insert(job), list(rows_of_jobs(1, number)))
    assert page.following is None
    assert seen == [9, 8, 7, 6, 5, 4, 3, 2, 1]


@pytest.fixture
async def full(new_database):
    """A farm with some thousand rows in every list."""
    of_policy = {"weights_format": "onnx", "weights_sha256": "0" * 64, "weights_bytes": 1, "graph_sha256": "0" * 64}
    of_policy |= {"name": "p", "manifest": "{}", "warnings": "[]", "created_at": AT}
    digests = [f"{number:064x}" for number in range(MANY)]
    async with new_database.write() as tx:
        await tx.execute(insert(job), list(rows_of_jobs(MANY)))
        of_trial = {"job_number": 1, "owner": "ann", "state": "done", "seed": 1}
        await tx.execute(insert(trial), [of_trial | {"trial_id": f"j1-{n:04d}", "ordinal": n} for n in range(1000)])
        other = {"job_number": 2, "owner": "bob", "state": "done", "seed": 1}
        await tx.execute(insert(trial), [other | {"trial_id": f"j2-{n:04d}", "ordinal": n} for n in range(1000)])
        owned = [{"owner": OWNERS[n % 3], "digest": digest} for n, digest in enumerate(digests)]
        await tx.execute(insert(policy), [of_policy | each for each in owned])
        await tx.execute(insert(policy_owner), [{"created_at": AT} | each for each in owned])
        named = [{"ladder_id": f"l{n}", "name": "l", "owner": OWNERS[n % 3], "created_at": AT} for n in range(MANY)]
        await tx.execute(insert(ladder), named)
        rungs = [
            {"ladder_number": n, "ordinal": place, "step": 0.0, "job_number": n} for n in range(1, MANY + 1) for place in range(4)
        ]
        await tx.execute(insert(rung), rungs)
    tokens = Tokens(new_database, FarmClock(0.0, 0.0))
    await tokens.keep({new_bearer(): TokenRequest(owner="ann", scopes=(Scope.SUBMIT,)) for _ in range(300)})
    async with new_database.write() as tx:
        await tx.execute(text("ANALYZE"))
    return new_database


async def of_tokens(database, _connection, asked):
    return await Tokens(database, FarmClock(0.0, 0.0)).page(asked)


async def of_policies(owner, _database, connection, asked):
    return await owners.page(connection, owner, asked)


async def of_ladders(owner, _database, connection, asked):
    return await ladders.lines(connection, owner, asked)


async def of_jobs(chosen, _database, connection, asked):
    return await lists.job_page(connection, chosen, asked)


async def of_trials(_database, connection, asked):
    return await lists.trial_page(connection, 1, asked)


LISTS = {
    "jobs": (partial(of_jobs, JobFilter()), 1500),
    "jobs of a user": (partial(of_jobs, JobFilter("ann")), 1500),
    "jobs in a state": (partial(of_jobs, JobFilter(None, JobState.FAILED)), 1500),
    "jobs of a user in a state": (partial(of_jobs, JobFilter("ann", JobState.FAILED)), 1500),
    "trials": (of_trials, 500),
    "policies": (partial(of_policies, None), 1500),
    "policies of a user": (partial(of_policies, "ann"), 1500),
    "ladders": (partial(of_ladders, None), 1500),
    "ladders of a user": (partial(of_ladders, "ann"), 1500),
    "tokens": (of_tokens, "7"),
}


async def test_every_page_of_every_list_is_read_from_an_index_in_its_order(full):
    wrong = {}
    for name, (read, middle) in LISTS.items():
        for after in (None, middle):
            plans = await plans_of(full, read, Asked(25, after))
            assert plans, name
            if bad := [step for step in plans if is_costly(step)]:
                wrong[name, after] = bad
    assert not wrong


async def test_a_list_in_an_order_without_an_index_would_be_found(full):
    async def by_policy_name(_database, connection, asked):
        return await read_page(connection, select(job), job.c.policy_name, asked)

    assert any(is_costly(step) for step in await plans_of(full, by_policy_name, Asked(25)))


async def plans_of(database, read, asked):
    """How the database goes about the statements of a page, each as a text of steps."""
    async with database.read() as connection:
        with Reading(database) as reading:
            await read(database, connection, asked)
    steps = []
    async with database.read() as connection:
        if database.is_shared:  # a table of this size is read whole though there is an index
            await connection.execute(text("SET enable_seqscan = off"))
        for statement, parameters in reading.asked:
            if database.is_shared:
                explained = await connection.exec_driver_sql(f"EXPLAIN (FORMAT JSON) {statement}", parameters)
                plan = explained.scalar_one()
                steps += nodes((json.loads(plan) if isinstance(plan, str) else plan)[0]["Plan"])
            else:
                explained = await connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", parameters)
                steps += [row.detail for row in explained]
    return steps


def nodes(plan):
    yield f"{plan['Node Type']} {plan.get('Relation Name', '')} {plan.get('Plan Rows')}"
    for below in plan.get("Plans", ()):
        yield from nodes(below)


def is_costly(step):
    """A sort of more than a page, or a whole table; SQLite's words, or PostgreSQL's."""
    if step.startswith("SCAN"):
        return " USING " not in step and step.removeprefix("SCAN ") not in {"job", "policy", "policy_owner", "ladder"}
    if step.startswith("Seq Scan"):
        return True
    return "TEMP B-TREE FOR ORDER BY" in step
