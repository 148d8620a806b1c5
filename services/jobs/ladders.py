"""Ladders: jobs of several checkpoints that are queued together, try the same goals, and are shown together."""

from sqlalchemy import func, insert, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobRequest, JobState, TaskName
from api_schemas.ladder import Ladder, LadderLine, LadderRequest, Rung
from api_schemas.physics import ObjectName
from api_schemas.success_rate import wilson
from services.database.pages import Asked, Page, read_page
from services.database.rows import AnyRow
from services.database.tables import job, ladder, rung
from services.errors import Conflict, NotFound
from services.jobs import submission
from services.jobs.clock import iso
from services.jobs.submission import Sender

LEVEL = 0.80
_LATER_FIELDS = frozenset({"priority"})
"""Fields of a ladder that came after its first form."""


async def submit(tx: AsyncConnection, now_s: float, request: LadderRequest, sender: Sender) -> tuple[str, bool]:
    """Inserts a ladder with all of its jobs; gives its id and whether it is new.

    Raises:
        NotFound: a policy was not uploaded, or by others only.
        Conflict: the idempotency key was used for another ladder.
        TooMany: with these jobs the sender would exceed the limit of unended ones.
    """
    digest = submission.digest_of(request, _LATER_FIELDS)
    if (earlier := await _earlier(tx, sender, digest)) is not None:
        return earlier, False
    ladder_id = submission.new_id("l")
    number = await _insert(tx, now_s, ladder_id, request, sender, digest)
    seed = submission.draw_seed() if request.seed is None else None
    of_each = Sender(sender.owner, None, sender.sees_only, sender.may_queue)
    for ordinal, each in enumerate(request.rungs):
        wish = JobRequest(
            policy=each.policy,
            task=request.task,
            trials=request.trials,
            seed=request.seed,
            object=request.object,
            object_scale=request.object_scale,
            priority=request.priority,
        )
        job_id, _ = await submission.submit(tx, now_s, wish, of_each, drawn_seed=seed)
        made = select(job.c.number).where(job.c.job_id == job_id).scalar_subquery()
        await tx.execute(insert(rung).values(ladder_number=number, ordinal=ordinal, step=each.step, job_number=made))
    return ladder_id, True


async def _earlier(tx: AsyncConnection, sender: Sender, digest: str) -> str | None:
    """The ladder that was made with this key before."""
    key = sender.idempotency_key
    if key is None:
        return None
    found = select(ladder).where(ladder.c.owner == sender.owner, ladder.c.idempotency_key == key)
    earlier: AnyRow | None = (await tx.execute(found)).one_or_none()
    if earlier is not None and earlier.request_sha256 != digest:
        detail = f"Idempotency-Key {key!r} was used for ladder {earlier.ladder_id} with another body; choose a new key."
        raise Conflict("idempotency-key-reused", detail, ladder_id=earlier.ladder_id)
    return None if earlier is None else earlier.ladder_id


async def _insert(tx: AsyncConnection, now_s: float, ladder_id: str, request: LadderRequest, sender: Sender, digest: str) -> int:
    row = insert(ladder).values(
        ladder_id=ladder_id,
        name=request.name,
        owner=sender.owner,
        created_at=iso(now_s),
        idempotency_key=sender.idempotency_key,
        request_sha256=digest,
    )
    try:
        return (await tx.execute(row.returning(ladder.c.number))).scalar_one()
    except IntegrityError as error:
        # On a database with several writers another request with this key may have come in between.
        key = sender.idempotency_key
        raise Conflict("idempotency-key-in-use", f"Idempotency-Key {key!r} is in use; ask again.") from error


async def show(connection: AsyncConnection, ladder_id: str, owner: str | None) -> Ladder:
    """A ladder; with ``owner`` only if it is theirs.

    Raises:
        NotFound: there is no such ladder, or it is another's.
    """
    row = (await connection.execute(select(ladder).where(ladder.c.ladder_id == ladder_id))).one_or_none()
    if row is None or owner not in (None, row.owner):
        raise NotFound("ladder-not-found", f"There is no ladder {ladder_id} of yours; GET /v1/ladders lists them.")
    wanted = select(job, rung.c.step).join(rung, rung.c.job_number == job.c.number).where(rung.c.ladder_number == row.number)
    jobs = (await connection.execute(wanted.order_by(rung.c.step, rung.c.ordinal))).all()
    first = jobs[0]
    return Ladder(
        ladder_id=row.ladder_id,
        name=row.name,
        owner=row.owner,
        created_at=row.created_at,
        task=TaskName(first.task),
        object=ObjectName(first.object),
        object_scale=first.object_scale,
        trials=first.trials,
        seed=first.seed,
        seed_drawn_by_server=first.seed_drawn_by_server,
        rungs=tuple(_rung(each) for each in jobs),
    )


def _rung(row: AnyRow) -> Rung:
    done = row.trials_done
    return Rung(
        step=row.step,
        job_id=row.job_id,
        state=JobState(row.state),
        policy=row.policy,
        policy_name=row.policy_name,
        trials=row.trials,
        trials_done=done,
        successes=row.successes,
        success_rate=row.successes / done if done else None,
        interval_80=wilson(row.successes, done, LEVEL) if done else None,
    )


async def lines(connection: AsyncConnection, owner: str | None, asked: Asked) -> Page[LadderLine]:
    """Ladders, newest first; with ``owner`` only theirs. The key is the ladder's number."""
    wanted = select(ladder.c.number) if owner is None else select(ladder.c.number).where(ladder.c.owner == owner)
    page = await read_page(connection, wanted, ladder.c.number, asked)
    counts = func.count(), func.sum(job.c.trials), func.sum(job.c.trials_done), func.min(job.c.task)
    wanted = (
        select(ladder, *(count.label(name) for count, name in zip(counts, ("rungs", "trials", "done", "task"), strict=True)))
        .join(rung, rung.c.ladder_number == ladder.c.number)
        .join(job, job.c.number == rung.c.job_number)
        .where(rung.c.ladder_number.in_([row.number for row in page.entries]))
        .group_by(ladder.c.number)
        .order_by(ladder.c.number.desc())
    )
    return Page([_line(row) for row in await connection.execute(wanted)], page.following)


def _line(row: AnyRow) -> LadderLine:
    return LadderLine(
        ladder_id=row.ladder_id,
        name=row.name,
        owner=row.owner,
        created_at=row.created_at,
        task=TaskName(row.task),
        rungs=row.rungs,
        trials=row.trials,
        trials_done=row.done,
    )
