"""Calls of jobs that have ended: signed, made once by whoever takes them, tried again and given up in the end."""

import json
from dataclasses import replace

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from sqlalchemy import insert, select, update

from api_schemas.job import JobRequest
from api_schemas.webhook import WebhookCall, signed_bytes
from services.database.tables import job, policy, webhook
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.submission import Sender, submit
from services.signing import FarmKey
from services.webhooks.delivery import AGAIN_AFTER_S, Deliverer, register, show

DIGEST = "d" * 64
POLICY = {"number": 1, "digest": DIGEST, "name": "p", "weights_format": "onnx", "weights_sha256": DIGEST, "weights_bytes": 1}
POLICY |= {"graph_sha256": DIGEST, "manifest": "{}", "warnings": "[]", "owner": "ann", "created_at": "now"}
KEY = FarmKey(b"k" * 32)


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
    return new_database


async def ended_job(database, url, state="succeeded"):
    async with database.write() as tx:
        wish = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 4, "webhook": url})
        job_id, _ = await submit(tx, 1000.0, wish, Sender("ann"))
        await register(tx, job_id, url)
        await tx.execute(update(job).where(job.c.job_id == job_id).values(state=state))
    return job_id


async def shown(database):
    async with database.read() as connection:
        return await show(connection, (await connection.execute(select(job))).one())


def deliverer(database, reach):
    return Deliverer("farm", database, FarmClock.start(), Fleet(), KEY, reach)


async def test_a_call_is_made_once_and_its_receiver_knows_who_sent_it(database, receiving, here):
    async with receiving() as receiver:
        job_id = await ended_job(database, receiver.url)
        both = [deliverer(database, here) for _ in range(2)]
        assert await both[0].deliver() + await both[1].deliver() == 1
        assert await both[0].deliver() == 0
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
        assert await deliverer(database, here).deliver() == 0
        assert receiver.connections == 0


async def test_tries_are_counted_and_end(database, receiving, here):
    calls = deliverer(database, here)
    async with receiving(answer=b"HTTP/1.1 503 Later\r\n\r\n") as receiver:
        await ended_job(database, receiver.url)
        for tries in range(1, len(AGAIN_AFTER_S) + 2):
            assert await calls.deliver() == 1
            assert await calls.deliver() == 0, "not before the pause is over"
            assert (await shown(database)).tries == tries
            async with database.write() as tx:
                await tx.execute(update(webhook).where(webhook.c.due_s.is_not(None)).values(due_s=0.0))
        assert await calls.deliver() == 0
    now = await shown(database)
    assert (now.is_open, now.said) == (False, "given up after 5 tries: answered 503")
    assert len(receiver.requests) == 5


async def test_what_may_not_be_called_is_given_up_at_once(database, receiving, here):
    async with receiving() as receiver:
        await ended_job(database, receiver.url)
        await deliverer(database, replace(here, may_call=lambda _: False)).deliver()
        assert receiver.connections == 0
    now = await shown(database)
    assert (now.is_open, now.said) == (False, "given up: the host is not on the public Internet, and only such are called")
