"""On each home: a policy goes when its owner wants it and nothing refers to it."""

import pytest
from sqlalchemy import insert, select

from api_schemas.canary import CanaryRequest
from api_schemas.job import JobRequest
from services.database.tables import policy, policy_owner
from services.errors import Conflict, NotFound
from services.jobs import canary
from services.jobs.submission import Sender, submit
from services.policies import owners
from tests.unit.services.dispatcher.conftest import POLICY

D = POLICY["digest"]


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        for owner in ("ann", "bob"):
            await owners.own(tx, D, owner, "now")
    return new_database


async def disown(database, owner):
    async with database.write() as tx:
        await owners.disown(tx, D, owner)


async def left(database):
    async with database.read() as connection:
        claims = (await connection.execute(select(policy_owner.c.owner).order_by(policy_owner.c.owner))).scalars().all()
        return claims, len((await connection.execute(select(policy))).all())


async def send(database, owner):
    async with database.write() as tx:
        return (await submit(tx, 1.0, JobRequest(policy=D, task="push", trials=1), Sender(owner)))[0]


async def test_it_is_forgotten_when_its_last_owner_wants_it(database):
    await disown(database, "ann")
    assert await left(database) == (["bob"], 1)
    with pytest.raises(NotFound, match="ann has no policy"):
        await disown(database, "ann")
    await disown(database, "bob")
    assert await left(database) == ([], 0)


async def test_what_a_job_refers_to_is_kept_whoever_wants_it_gone(database):
    job_id = await send(database, "ann")
    with pytest.raises(Conflict, match=f"is that of job {job_id}; what") as caught:
        await disown(database, "ann")
    assert (caught.value.slug, caught.value.members) == ("policy-in-use", {"jobs": 1, "newest_job": job_id})
    assert await left(database) == (["ann", "bob"], 1)
    await disown(database, "bob")  # no job of his
    assert await left(database) == (["ann"], 1)


@pytest.mark.parametrize("by", ["a job", "the canary"])
async def test_what_others_need_is_kept_too_and_their_jobs_are_not_named(database, by):
    if by == "a job":
        await send(database, "operator")
    else:
        async with database.write() as tx:
            await canary.choose(tx, 1.0, CanaryRequest(policy=D, task="push", at_least=0.5), "operator")
    await disown(database, "bob")
    with pytest.raises(Conflict, match="somebody else's") as caught:
        await disown(database, "ann")
    assert caught.value.members == {}
    assert await left(database) == (["ann"], 1)
