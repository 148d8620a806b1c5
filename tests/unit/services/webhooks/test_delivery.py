"""Calls of jobs that have ended: signed, made once by whoever takes them, tried again and given up in the end."""

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest
from api_schemas.webhook import WebhookCall, signed_bytes
from services.database.tables import job, policy, webhook
from services.errors import TooMany, Unavailable
from services.jobs.cancellation import cancel
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.submission import Sender, submit
from services.signing import FarmKey
from services.webhooks.calling import NO_ANSWER
from services.webhooks.delivery import AGAIN_AFTER_S, AT_ONCE, AT_ONCE_OF_OWNER, MOST_OPEN, Deliverer, register, show

DIGEST = "d" * 64
POLICY = {"number": 1, "digest": DIGEST, "name": "p", "weights_format": "onnx", "weights_sha256": DIGEST, "weights_bytes": 1}
POLICY |= {"graph_sha256": DIGEST, "manifest": "{}", "warnings": "[]", "owner": "ann", "created_at": "now"}
KEY = FarmKey(b"k" * 32)


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
    return new_database


async def ended_job(database, url, state="succeeded", owner="ann"):
    async with database.write() as tx:
        wish = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 4})
        job_id, _ = await submit(tx, 1000.0, wish, Sender(owner))
        await register(tx, job_id, url)
        await tx.execute(update(job).where(job.c.job_id == job_id).values(state=state))
    return job_id


async def shown(database):
    async with database.read() as connection:
        return await show(connection, (await connection.execute(select(job))).one())


def deliverer(database, reach):
    return Deliverer("farm", database, FarmClock.start(), Fleet(), KEY, reach)


async def deliver(calls):
    """Has what is due called to the end; gives how many calls that were."""
    begun = await calls.deliver()
    await calls.end(within_s=120)
    return begun


async def test_a_call_is_made_once_and_its_receiver_knows_who_sent_it(database, receiving, here):
    async with receiving() as receiver:
        job_id = await ended_job(database, receiver.url)
        both = [deliverer(database, here) for _ in range(2)]
        assert await deliver(both[0]) + await deliver(both[1]) == 1
        assert await deliver(both[0]) == 0
    (request,) = receiver.requests
    head, _, body = request.partition(b"\r\n\r\n")
    headers = dict(line.split(": ", 1) for line in head.decode().splitlines()[1:])
    assert WebhookCall.model_validate_json(body).job.job_id == job_id
    assert json.loads(body)["event"] == "job_ended"
    key, signature = (
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(KEY.public_hex)),
        bytes.fromhex(headers["X-Trifarm-Signature"]),
    )
    key.verify(signature, signed_bytes(headers["X-Trifarm-Timestamp"], body))
    for timestamp, changed in ((headers["X-Trifarm-Timestamp"], body + b" "), ("1", body)):
        with pytest.raises(InvalidSignature):
            key.verify(signature, signed_bytes(timestamp, changed))
    now = await shown(database)
    assert (now.tries, now.is_open, now.said) == (1, False, "delivered: answered 204")


async def test_a_job_that_has_not_ended_calls_nobody(database, receiving, here):
    async with receiving() as receiver:
        await ended_job(database, receiver.url, state="running")
        assert await deliver(deliverer(database, here)) == 0
        assert receiver.connections == 0


async def test_tries_are_counted_and_end(database, receiving, here):
    calls = deliverer(database, here)
    async with receiving(answer=b"HTTP/1.1 503 Later\r\n\r\n") as receiver:
        await ended_job(database, receiver.url)
        for tries in range(1, len(AGAIN_AFTER_S) + 2):
            assert await deliver(calls) == 1
            assert await deliver(calls) == 0, "not before the pause is over"
            assert (await shown(database)).tries == tries
            async with database.write() as tx:
                await tx.execute(update(webhook).where(webhook.c.due_s.is_not(None)).values(due_s=0.0))
        assert await deliver(calls) == 0
    now = await shown(database)
    assert (now.is_open, now.said) == (False, "given up after 5 tries: answered 503")
    assert len(receiver.requests) == 5


async def test_what_may_not_be_called_is_not_and_looks_like_a_host_that_is_away(database, receiving, here):
    async def nowhere(_host, _port):
        return []

    async with receiving() as receiver:
        for reach in (replace(here, may_call=lambda _: False), replace(here, resolve=nowhere)):
            await ended_job(database, receiver.url)
            await deliver(deliverer(database, reach))
        assert receiver.connections == 0
    async with database.read() as connection:
        rows = (await connection.execute(select(webhook))).all()
        seen = [(row.tries, row.due_s is not None, row.said) for row in rows]
    assert seen == [(1, True, f"try 1 failed: {NO_ANSWER}")] * 2


async def test_the_slow_receivers_of_one_owner_delay_nobody_else(database, receiving, here):
    calls = deliverer(database, replace(here, within_s=300.0))
    async with receiving(answer=None) as slow, receiving() as quick:
        for _ in range(AT_ONCE + 1):
            await ended_job(database, slow.url)
        await ended_job(database, quick.url, owner="bob")
        assert await calls.deliver() == AT_ONCE_OF_OWNER + 1
        assert await calls.deliver() == 0, "the slow ones are under way, and no more of their owner are begun"
        said = await said_to_owners(database)
        while said["bob"] == {None} or slow.connections < AT_ONCE_OF_OWNER:
            await asyncio.sleep(0.05)
            said = await said_to_owners(database)
        await calls.end(within_s=0.2)
        assert slow.connections == AT_ONCE_OF_OWNER and len(quick.requests) == 1
    assert said == {"ann": {None}, "bob": {"delivered: answered 204"}} == await said_to_owners(database)


async def said_to_owners(database):
    """What is known of each owner's calls."""
    async with database.read() as connection:
        rows = (await connection.execute(select(job.c.owner, webhook.c.said).join(webhook))).all()
    return {owner: {said for other, said in rows if other == owner} for owner, _ in rows}


async def test_a_call_is_due_from_the_end_of_its_job(database):
    job_id = await ended_job(database, "https://a.example/", state="queued")
    async with database.write() as tx:
        number = (await tx.execute(select(job.c.number).where(job.c.job_id == job_id))).scalar_one()
        await cancel(tx, 2000.0, number)
        assert (await tx.execute(select(webhook.c.due_s))).scalar_one() == 2000.0


async def test_an_owner_has_so_many_open_webhooks_and_others_are_not_asked(database):
    job_ids = [await ended_job(database, "https://a.example/") for _ in range(2)]
    async with database.write() as tx:
        number = (await tx.execute(select(job.c.number).where(job.c.job_id == job_ids[0]))).scalar_one()
        wish = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 1})
        for _ in range(MOST_OPEN - 2):
            await register(tx, (await submit(tx, 1000.0, wish, Sender("ann")))[0], "https://a.example/")
        one_more, _ = await submit(tx, 1000.0, wish, Sender("ann"))
        with pytest.raises(TooMany, match="has 100 webhooks that are still to be called and may have 100"):
            await register(tx, one_more, "https://a.example/")
        await register(tx, (await submit(tx, 1000.0, wish, Sender("bob")))[0], "https://a.example/")
        await tx.execute(update(webhook).where(webhook.c.job_number == number).values(due_s=None))
        await register(tx, one_more, "https://a.example/")


async def test_what_nobody_expected_ends_one_call_and_no_other(database, receiving, here):
    async def resolve(host, port):
        if host == "bad.example":
            raise LookupError("nobody expected this")
        return await here.resolve(host, port)

    async with receiving() as receiver:
        bad, good = await ended_job(database, "https://bad.example/"), await ended_job(database, receiver.url)
        calls = deliverer(database, replace(here, resolve=resolve))
        assert await deliver(calls) == 2
        async with database.write() as tx:
            await tx.execute(update(webhook).where(webhook.c.due_s.is_not(None)).values(due_s=0.0))
        assert await deliver(calls) == 0
    async with database.read() as connection:
        said = dict((await connection.execute(select(job.c.job_id, webhook.c.said).join(webhook))).all())
    assert said[good] == "delivered: answered 204" and said[bad].startswith("given up: the farm could not make this call")


async def test_a_database_that_is_away_for_a_moment_ends_no_call(database, receiving, here, monkeypatch):
    read, reads = database.read, []

    @asynccontextmanager
    async def away_for_the_body():
        reads.append(1)
        if len(reads) == 2:
            raise Unavailable("database-unavailable", "away")
        async with read() as connection:
            yield connection

    async with receiving() as receiver:
        await ended_job(database, receiver.url)
        calls = deliverer(database, here)
        with monkeypatch.context() as patched:
            patched.setattr(database, "read", away_for_the_body)
            assert await deliver(calls) == 1
        assert receiver.connections == 0 and (await shown(database)).is_open
        async with database.write() as tx:
            await tx.execute(update(webhook).values(due_s=0.0))
        assert await deliver(calls) == 1
    assert (await shown(database)).said == "delivered: answered 204"


async def test_tries_that_were_broken_off_count_too(database, receiving, here):
    async with receiving() as receiver:
        await ended_job(database, receiver.url)
        async with database.write() as tx:
            await tx.execute(update(webhook).values(tries=len(AGAIN_AFTER_S) + 1))
        await deliver(deliverer(database, here))
        assert receiver.connections == 0
    now = await shown(database)
    assert (now.is_open, now.said) == (False, "given up after 5 tries: the farm stopped during the last")
