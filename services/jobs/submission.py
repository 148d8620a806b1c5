"""A job comes in: the job and its n trials, of a large job the first page of them, in one transaction."""

import base64
import hashlib
import secrets
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel
from sqlalchemy import func, insert, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.excitation import ANY_ROBOT, IdentificationRequest
from api_schemas.job import MAX_SEED, EventKind, JobRequest, JobState, TaskName
from api_schemas.policy import PolicyManifest
from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.database.tables import NORMAL_RANK, job, robot
from services.errors import Conflict, NotFound, Refused, TooMany
from services.jobs import events, goals, making, physics, questions
from services.jobs.clock import iso
from services.jobs.goals import TrialDraw
from services.jobs.lease import UNENDED
from services.jobs.priority import RANKS
from services.policies import owners
from services.settings import TRIALS_PAGE

LATER_FIELDS = frozenset(
    {
        *("object", "object_scale", "webhook", "priority", "goals", "like", "question", "recipe", "training_seed"),
        *("images", "name", "note"),
    }
)
"""Fields of a job that came after its first form; a job sent before they came and again afterwards is one job."""

_NOT_ITS = ("question", "webhook", "recipe", "training_seed", "name", "note")
"""What is asked of a job and not of the other one that its question is about."""

LOOK_AGAIN_S = 30
"""When a user whose share of the queue is used up may ask again at the earliest; how long jobs take nobody knows."""


@dataclass(frozen=True)
class Sender:
    """Who sends a job, and the key under which it may be sent again.

    ``sees_only`` is the owner whose policies alone may be used, ``may_queue`` the limit of unended jobs,
    ``may_queue_trials`` that of their trials that are not done, and ``may_ask`` that of one job's trials; None is all.
    """

    owner: str
    idempotency_key: str | None = None
    sees_only: str | None = None
    may_queue: int | None = None
    may_queue_trials: int | None = None
    may_ask: int | None = None


@dataclass(frozen=True)
class _NewJob:
    """What is asked for: ``values`` of the job's row, its trials, and its sentence."""

    values: dict[str, Any]
    trials: Sequence[TrialDraw]
    seed: int | None
    text: str
    drawn_seed: int | None = None
    page: int | None = None


async def submit(
    tx: AsyncConnection,
    now_s: float,
    request: JobRequest,
    sender: Sender,
    *,
    drawn_seed: int | None = None,
    pinned: Mapping[str, object] | None = None,
    judged: bool = False,
    page: int = TRIALS_PAGE,
    blind: bool = False,
) -> tuple[str, bool]:
    """Inserts a job of a policy; gives its id and whether it is new.

    ``drawn_seed`` is what the server has drawn for several jobs; it serves where none is asked for. ``pinned`` are values of the
    row of a job that one robot runs, its name among them. ``judged`` is a job that the question of another ends. Of a job whose
    goals are told by its seed no more than ``page`` trials are made now; the others follow (``filling.py``). ``blind``
    says that no robot has cameras.

    Raises:
        NotFound: the policy was not uploaded, or by others only.
        Conflict: the idempotency key was used for another request.
        Refused: the job whose goals are wanted is of another task, the question is about one policy, or the policy sees and no
            robot does.
        TooMany: the sender has reached the limit of unended jobs, or of their trials.
    """
    digest = digest_of(request)
    if (earlier := await _earlier(tx, sender, digest)) is not None:
        return earlier, False
    _check_size(request.trials, sender)
    kept = await owners.find(tx, request.policy, sender.sees_only)
    if kept is None:
        raise NotFound("policy-not-found", f"No policy has the digest {request.policy}; upload it first with POST /v1/policies.")
    if blind:
        _check_sight(kept)
    source = None if request.goals_of is None else await goals.source(tx, request, sender.sees_only)
    if request.question is not None and request.goals is not None:  # a test at every look needs goals in an order by chance
        request = request.model_copy(update={"goals": secrets.SystemRandom().sample(request.goals, len(request.goals))})
    twin = None
    if request.question is not None and request.question.against is not None and source is None:
        seed = request.seed if request.seed is not None else drawn_seed if drawn_seed is not None else draw_seed()
        await _check_share(tx, sender, of="a question against a policy is two jobs", jobs=2, trials=2 * request.trials)
        drawn_seed, twin = seed, await _submit_twin(tx, now_s, request, sender, seed)
    draws = await goals.draws(tx, request, source)
    values: dict[str, Any] = {
        "policy": request.policy,
        "policy_name": kept.name,
        "task": request.task,
        "object": request.object,
        "object_scale": request.object_scale,
        "priority": RANKS[request.priority],
        "images": request.images,
        "judged": request.question is not None or judged,
        "recipe": request.recipe,
        "training_seed": request.training_seed,
        "name": (request.name or "").strip() or None,
        "note": (request.note or "").strip() or None,
        "own_goals": any(each.own_goal is not None for each in draws),
        **(pinned or {}),
    }
    most = "" if request.question is None else "at most "
    text = f"job queued: {most}{len(draws)} trials of {request.task} with policy {kept.name}"
    seed = request.seed if source is None else source.seed
    by_seeds = source is None and request.goals is None and not values["judged"] and pinned is None
    asked = _NewJob(values, draws, seed, text, drawn_seed, page if by_seeds else None)
    job_id = await _insert(tx, now_s, asked, sender, digest)
    if request.question is not None:
        number = (await tx.execute(select(job.c.number).where(job.c.job_id == job_id))).scalar_one()
        other = twin if source is None else source.number
        await questions.ask(tx, number, request.question, len(draws), other, is_twin=twin is not None)
    return job_id, True


def _check_sight(kept: AnyRow) -> None:
    """Raises if the policy sees; no robot does.

    Raises:
        Refused: it does.
    """
    if PolicyManifest.model_validate_json(kept.manifest).images is not None:
        raise Refused(
            "no-cameras",
            f"Policy {kept.name} sees images, and no robot of this farm has cameras: their machine needs the extra 'vision' "
            "and EGL (apt-get install libegl1 libgl1-mesa-dri renders in software).",
        )


async def _submit_twin(tx: AsyncConnection, now_s: float, request: JobRequest, sender: Sender, seed: int) -> int:
    """Inserts the job of the other policy, which ends with the question; gives its number."""
    assert request.question is not None and request.question.against is not None, "it is asked against a policy"
    if request.question.against == request.policy:
        raise Refused("same-policy", "A policy is not better than itself; name another one, or a bar.")
    wish = request.model_copy(update={"policy": request.question.against, **dict.fromkeys(_NOT_ITS)})
    of_twin = replace(sender, idempotency_key=None, may_queue=None, may_queue_trials=None)  # both were asked for at once
    job_id, _ = await submit(tx, now_s, wish, of_twin, drawn_seed=seed, judged=True)
    return (await tx.execute(select(job.c.number).where(job.c.job_id == job_id))).scalar_one()


async def identify(
    tx: AsyncConnection, now_s: float, request: IdentificationRequest, sender: Sender, present: Collection[str] = ()
) -> tuple[str, bool]:
    """Inserts an identification; gives its job's id and whether it is new.

    ``present``: robots that have come, the newest of which may not be written down yet.

    Raises:
        NotFound: no robot of this name ever joined.
        Conflict: the idempotency key was used for another request.
        TooMany: the sender has reached the limit of unended jobs.
    """
    digest = digest_of(request)
    if (earlier := await _earlier(tx, sender, digest)) is not None:
        return earlier, False
    named = None if request.robot == ANY_ROBOT else request.robot
    is_known = named is None or named in present
    if not is_known and (await tx.execute(select(robot.c.robot).where(robot.c.robot == named))).first() is None:
        detail = f"No robot named {named} ever joined this farm; GET /v1/robots lists them, '{ANY_ROBOT}' takes the first idle."
        raise NotFound("robot-not-found", detail)
    courses = request.courses()
    text = f"job queued, excitations: {len(courses)}, on {named or 'one robot, the first that is idle'}"
    draws = [TrialDraw(excitation=course) for course in courses]
    asked = _NewJob({"task": TaskName.IDENTIFY, "robot": named, "any_robot": named is None}, draws, request.seed, text)
    return await _insert(tx, now_s, asked, sender, digest), True


def new_id(kind: str) -> str:
    """The kind's letter and twelve characters of a-z and 2-7: 60 random bits."""
    return kind + base64.b32encode(secrets.token_bytes(8)).decode().lower()[:12]


def draw_seed() -> int:
    """A seed that nobody could know before."""
    return secrets.randbelow(MAX_SEED)


def digest_of(request: BaseModel, later: frozenset[str] = LATER_FIELDS) -> str:
    """Of all that was asked, without what was not there to ask for when the first were sent and was not asked for now."""
    fields = type(request).model_fields
    unasked = {name for name in later & fields.keys() if getattr(request, name) == fields[name].default}
    return hashlib.sha256(request.model_dump_json(exclude=unasked).encode()).hexdigest()


async def _earlier(tx: AsyncConnection, sender: Sender, digest: str) -> str | None:
    """The job that was made with this key before."""
    key = sender.idempotency_key
    if key is None:
        return None
    found = select(job.c.job_id, job.c.request_sha256).where(job.c.owner == sender.owner, job.c.idempotency_key == key)
    earlier: AnyRow | None = (await tx.execute(found)).one_or_none()
    if earlier is not None and earlier.request_sha256 != digest:
        raise Conflict(
            "idempotency-key-reused",
            f"Idempotency-Key {key!r} was used for job {earlier.job_id} with another body; choose a new key.",
            job_id=earlier.job_id,
        )
    return None if earlier is None else earlier.job_id


def _check_size(trials: int, sender: Sender) -> None:
    if sender.may_ask is not None and trials > sender.may_ask:
        detail = (
            f"A job of this farm's users may have {sender.may_ask} trials, not {trials}. Ask for fewer in one job; the farm's "
            "operator can ask for more, or raise TRIFARM_MAX_TRIALS_PER_JOB."
        )
        raise Refused("too-many-trials", detail, trials=trials, limit=sender.may_ask)


async def _check_share(tx: AsyncConnection, sender: Sender, *, of: str = "", jobs: int = 1, trials: int = 0) -> None:
    """Whether the sender may have so many more jobs and trials; ``of`` says why it is more than one."""
    if sender.may_queue is None and sender.may_queue_trials is None:
        return
    await owners.hold(tx, sender.owner)
    unended = select(func.count(), func.coalesce(func.sum(job.c.trials - job.c.trials_done), 0))
    unended = unended.where(job.c.owner == sender.owner, job.c.state.in_(UNENDED))
    count, left = (await tx.execute(unended)).one()
    more = f" ({of})" if of else ""
    if sender.may_queue is not None and count + jobs > sender.may_queue:
        detail = (
            f"{sender.owner} has {count} jobs that have not ended and may have {sender.may_queue}{more}. Wait until one has "
            "ended, cancel one with POST /v1/jobs/<job>/cancel, or ask for more trials in one job."
        )
        raise TooMany("queued-jobs-quota", detail, LOOK_AGAIN_S, unended_jobs=count, limit=sender.may_queue)
    if sender.may_queue_trials is not None and left + trials > sender.may_queue_trials:
        detail = (
            f"{sender.owner} has {left} trials that are not done and may have {sender.may_queue_trials}; {trials} more are too "
            f"many{more}. Wait until some are done, cancel a job with POST /v1/jobs/<job>/cancel, or ask for fewer."
        )
        raise TooMany("queued-trials-quota", detail, LOOK_AGAIN_S, trials_left=left, limit=sender.may_queue_trials)


def _overtaken(key: str | None) -> Conflict:
    if key is None:
        return Conflict("policy-going", "The policy was deleted at this moment; upload it again.")
    return Conflict("idempotency-key-in-use", f"Idempotency-Key {key!r} is in use, or the policy was just deleted; ask again.")


async def _insert(tx: AsyncConnection, now_s: float, asked: _NewJob, sender: Sender, digest: str) -> str:
    await _check_share(tx, sender, trials=len(asked.trials))
    made = asked.page if asked.page is not None and asked.page < len(asked.trials) else None
    given = asked.drawn_seed if asked.seed is None else asked.seed
    job_id, seed = new_id("j"), draw_seed() if given is None else given
    row = insert(job).values(
        job_id=job_id,
        state=JobState.QUEUED,
        physics=physics.NOW,
        trials=len(asked.trials),
        trials_made=made,
        seed=seed,
        seed_drawn_by_server=asked.seed is None,
        owner=sender.owner,
        created_at=iso(now_s),
        created_s=now_s,
        idempotency_key=sender.idempotency_key,
        request_sha256=digest,
        **asked.values,
    )
    try:
        number = (await tx.execute(row.returning(job.c.number))).scalar_one()
    except IntegrityError as error:
        # On a database with several writers another request with this key, or the end of the policy, may have come in between.
        raise _overtaken(sender.idempotency_key) from error
    of = making.OfJob(job_id, number, seed, sender.owner, asked.values.get("priority", NORMAL_RANK))
    state = TrialState.HELD if asked.values.get("judged") else TrialState.QUEUED
    await making.make(tx, of, asked.trials if made is None else asked.trials[:made], state=state, named=asked.values.get("robot"))
    await events.record(tx, iso(now_s), number, EventKind.JOB_QUEUED, asked.text)
    return job_id
