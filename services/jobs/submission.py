"""A job comes in: the job and its n trials, in one transaction."""

import base64
import hashlib
import secrets

from sqlalchemy import insert, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import MAX_SEED, JobRequest, JobState
from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.database.tables import job, policy, trial
from services.errors import Conflict, NotFound
from services.jobs import events
from services.jobs.clock import iso
from services.jobs.order import trial_seed


async def submit(
    tx: AsyncConnection, now_s: float, request: JobRequest, *, owner: str, idempotency_key: str | None
) -> tuple[str, bool]:
    """Inserts a job; gives its id and whether it is new.

    Raises:
        NotFound: the policy was not uploaded.
        Conflict: the idempotency key was used for another request.
    """
    digest = hashlib.sha256(request.model_dump_json().encode()).hexdigest()
    if idempotency_key is not None and (earlier := await _earlier(tx, owner, idempotency_key)) is not None:
        return _same(earlier, digest, idempotency_key), False
    name = (await tx.execute(select(policy.c.name).where(policy.c.digest == request.policy))).scalar_one_or_none()
    if name is None:
        raise NotFound("policy-not-found", f"No policy has the digest {request.policy}; upload it first with PUT /v1/policies.")
    job_id = new_job_id()
    try:
        await _insert(tx, now_s, job_id, request, policy_name=name, owner=owner, idempotency_key=idempotency_key, digest=digest)
    except IntegrityError as error:
        # On a database with several writers another request with this key may have come in between.
        raise Conflict("idempotency-key-in-use", f"Idempotency-Key {idempotency_key!r} is in use; ask again.") from error
    return job_id, True


def new_job_id() -> str:
    """``j`` and twelve characters of a-z and 2-7: 60 random bits."""
    return "j" + base64.b32encode(secrets.token_bytes(8)).decode().lower()[:12]


async def _earlier(tx: AsyncConnection, owner: str, key: str) -> AnyRow | None:
    found = select(job.c.job_id, job.c.request_sha256).where(job.c.owner == owner, job.c.idempotency_key == key)
    return (await tx.execute(found)).one_or_none()


def _same(earlier: AnyRow, digest: str, key: str) -> str:
    if earlier.request_sha256 != digest:
        raise Conflict(
            "idempotency-key-reused",
            f"Idempotency-Key {key!r} was used for job {earlier.job_id} with another body; choose a new key.",
            job_id=earlier.job_id,
        )
    return earlier.job_id


async def _insert(
    tx: AsyncConnection,
    now_s: float,
    job_id: str,
    request: JobRequest,
    *,
    policy_name: str,
    owner: str,
    idempotency_key: str | None,
    digest: str,
) -> None:
    seed = secrets.randbelow(MAX_SEED) if request.seed is None else request.seed
    row = insert(job).values(
        job_id=job_id,
        state=JobState.QUEUED,
        policy=request.policy,
        policy_name=policy_name,
        task=request.task,
        trials=request.trials,
        seed=seed,
        seed_drawn_by_server=request.seed is None,
        owner=owner,
        created_at=iso(now_s),
        created_s=now_s,
        idempotency_key=idempotency_key,
        request_sha256=digest,
    )
    number = (await tx.execute(row.returning(job.c.number))).scalar_one()
    trials = [
        {
            "trial_id": f"{job_id}-{ordinal:03d}",
            "job_number": number,
            "ordinal": ordinal,
            "state": TrialState.QUEUED,
            "seed": trial_seed(seed, ordinal),
        }
        for ordinal in range(request.trials)
    ]
    await tx.execute(insert(trial), trials)
    text = f"job queued: {request.trials} trials of {request.task} with policy {policy_name}"
    await events.record(tx, iso(now_s), number, "job_queued", text)
