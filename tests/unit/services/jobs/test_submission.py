"""Jobs of policies come in once for each key, also when the farm was brought up to date in between."""

import hashlib

import pytest
from sqlalchemy import delete, insert, select

from api_schemas.job import JobRequest
from api_schemas.policy import LAYOUTS, canonical_json
from services.database.tables import job, policy
from services.errors import Conflict, Refused
from services.jobs.submission import Sender, submit
from services.policies import owners

DIGEST = "d" * 64
POLICY = {"digest": DIGEST, "name": "p", "weights_format": "onnx", "weights_sha256": DIGEST, "weights_bytes": 1}
POLICY |= {"graph_sha256": DIGEST, "manifest": "{}", "warnings": "[]", "owner": "ann", "created_at": "now"}
FIRST_FORM = f'{{"policy":"{DIGEST}","task":"push","trials":4,"seed":1}}'


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
    return new_database


async def send(database, **more):
    async with database.write() as tx:
        request = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 4, "seed": 1} | more)
        return await submit(tx, 1000.0, request, Sender("ann", "key"))


@pytest.mark.parametrize("new_database", ["postgres"], indirect=True)  # SQLite has one writer
@pytest.mark.parametrize(
    ("key", "says"), [(None, "policy was deleted at this moment"), ("key", "'key' is in use, or the policy")]
)
async def test_a_policy_that_is_deleted_while_a_job_of_it_comes_in_is_said(database, monkeypatch, key, says):
    find = owners.find

    async def found(tx, *named):
        was = await find(tx, *named)
        async with database.write() as other:
            await other.execute(delete(policy))
        return was

    monkeypatch.setattr(owners, "find", found)
    request = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 4})
    with pytest.raises(Conflict, match=says):
        async with database.write() as tx:
            await submit(tx, 1000.0, request, Sender("ann", key))


@pytest.mark.parametrize("more", [{}, {"object": "cube"}, {"object_scale": 1}, {"priority": "normal"}, {"images": False}])
async def test_a_job_of_the_first_form_that_is_sent_again_is_the_same_job(database, more):
    job_id, new = await send(database, **more)
    assert new
    async with database.read() as connection:
        kept = (await connection.execute(select(job.c.request_sha256))).scalar_one()
    assert kept == hashlib.sha256(FIRST_FORM.encode()).hexdigest()
    assert await send(database) == (job_id, False)


@pytest.mark.parametrize("more", [{"object": "sphere"}, {"object_scale": 0.8}, {"priority": "low"}, {"images": True}])
async def test_another_object_or_priority_is_another_job(database, more):
    await send(database)
    with pytest.raises(Conflict, match="with another body"):
        await send(database, **more)


@pytest.mark.parametrize(("layout", "blind", "taken"), [("images", True, False), ("images", False, True), ("push", True, True)])
async def test_a_policy_that_sees_needs_a_robot_that_does(new_database, layout, blind, taken):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY | {"manifest": canonical_json(LAYOUTS[layout])}))
    request = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 4})
    async with new_database.write() as tx:
        if taken:
            assert (await submit(tx, 1000.0, request, Sender("ann", "key"), blind=blind))[1]
        else:
            with pytest.raises(Refused, match="sees images, and no robot of this farm has cameras"):
                await submit(tx, 1000.0, request, Sender("ann", "key"), blind=blind)
