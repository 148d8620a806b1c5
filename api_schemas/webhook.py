"""Webhooks: what is sent to an address when a job has ended, and how its receiver knows that the farm sent it."""

from typing import Literal

from api_schemas.job import Job
from api_schemas.schema import Schema

SIGNATURE_HEADER = "X-Trifarm-Signature"
"""Ed25519 by the farm's key (GET /v1/key), as hexadecimal digits, over ``signed_bytes``."""
TIMESTAMP_HEADER = "X-Trifarm-Timestamp"
"""Seconds since 1970 of this try; a receiver leaves aside what is old."""


class WebhookCall(Schema):
    """The body of a call."""

    format: Literal["trifarm-webhook/1"] = "trifarm-webhook/1"
    event: Literal["job_ended"] = "job_ended"
    farm: str
    job: Job


class Webhook(Schema):
    """A job's webhook: ``said`` is what came of the last try, ``is_open`` whether another may follow."""

    job_id: str
    url: str
    tries: int
    is_open: bool
    said: str | None


def signed_bytes(timestamp: str, body: bytes) -> bytes:
    """What the signature of a call is over; nothing else that the farm signs begins like this."""
    return b"trifarm-webhook/1\n" + timestamp.encode() + b"\n" + body
