"""Ladders: jobs of several checkpoints that are queued together, try the same goals, and are shown together."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy import func, insert, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.anytime import is_decided, rate_sequence
from api_schemas.correlation import Correlation, rank_correlation
from api_schemas.job import JobRequest, JobState, TaskName
from api_schemas.ladder import Ladder, LadderEnds, LadderLine, LadderRequest, Rung
from api_schemas.letters import letters_where, pair_chance
from api_schemas.physics import ObjectName
from api_schemas.success_rate import SHOWN_LEVEL, wilson
from services.database.pages import Asked, Page, read_page
from services.database.rows import AnyRow
from services.database.tables import job, ladder, rung
from services.errors import Conflict, NotFound
from services.jobs import outcomes, submission
from services.jobs.clock import iso
from services.jobs.submission import Sender

_LATER_FIELDS = frozenset({"priority", "ends"})
"""Fields of a ladder that came after its first form; of its rungs, ``training_reward`` did."""
MOST_COMPARED = 40
"""With more rungs no pair could be told apart within the usual number of goals, and a page would compare thousands."""


async def submit(tx: AsyncConnection, now_s: float, request: LadderRequest, sender: Sender) -> tuple[str, bool]:
    """Inserts a ladder with all of its jobs; gives its id and whether it is new.

    Raises:
        NotFound: a policy was not uploaded, or by others only.
        Conflict: the idempotency key was used for another ladder.
        TooMany: with these jobs the sender would exceed the limit of unended ones.
    """
    digest = _digest_of(request)
    if (earlier := await _earlier(tx, sender, digest)) is not None:
        return earlier, False
    ladder_id = submission.new_id("l")
    number = await _insert(tx, now_s, ladder_id, request, sender, digest)
    seed = submission.draw_seed() if request.seed is None else None
    of_each = replace(sender, idempotency_key=None)
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
        job_id, _ = await submission.submit(tx, now_s, wish, of_each, drawn_seed=seed, judged=request.ends is not None)
        made = select(job.c.number).where(job.c.job_id == job_id).scalar_subquery()
        said = {"step": each.step, "training_reward": each.training_reward}
        await tx.execute(insert(rung).values(ladder_number=number, ordinal=ordinal, job_number=made, **said))
    return ladder_id, True


def _digest_of(request: LadderRequest) -> str:
    """Of all that was asked; a ladder without rewards is the one that it was before there were any."""
    if any(each.training_reward is not None for each in request.rungs):
        return submission.digest_of(request, _LATER_FIELDS)
    body = request.model_dump_json(exclude={"rungs": {"__all__": {"training_reward"}}} | _unasked(request))
    return hashlib.sha256(body.encode()).hexdigest()


def _unasked(request: LadderRequest) -> dict[str, bool]:
    fields = type(request).model_fields
    return {name: True for name in _LATER_FIELDS if getattr(request, name) == fields[name].default}


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
        ends=request.ends,
        is_racing=request.ends is not None,
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
    columns = (rung.c.step, rung.c.training_reward, rung.c.given_up)
    wanted = select(job, *columns).join(rung, rung.c.job_number == job.c.number).where(rung.c.ladder_number == row.number)
    jobs = (await connection.execute(wanted.order_by(rung.c.step, rung.c.ordinal))).all()
    first, letters = jobs[0], await _letters(connection, jobs)
    rungs = tuple(_rung(each, told, row.ends is not None) for each, told in zip(jobs, letters, strict=True))
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
        rungs=rungs,
        ends=None if row.ends is None else LadderEnds(row.ends),
        best=_best(rungs),
        correlations=_correlations(rungs),
    )


def _rung(row: AnyRow, letters: str | None, may_end: bool) -> Rung:
    done = row.trials_done if row.counted_trials is None else row.counted_trials
    successes = row.successes if row.counted_trials is None else row.counted_successes
    interval = rate_sequence if may_end else wilson
    return Rung(
        step=row.step,
        job_id=row.job_id,
        state=JobState(row.state),
        policy=row.policy,
        policy_name=row.policy_name,
        trials=row.trials,
        trials_done=done,
        successes=successes,
        success_rate=successes / done if done else None,
        interval_80=interval(successes, done, 0.80) if done else None,
        interval_95=interval(successes, done, SHOWN_LEVEL) if done else None,
        training_reward=row.training_reward,
        given_up=row.given_up,
        letters=letters,
    )


def _best(rungs: Sequence[Rung]) -> str | None:
    """The rung with the highest lower bound; of equals the later one."""
    bounds = [(rung.interval_95[0], at) for at, rung in enumerate(rungs) if rung.interval_95 is not None]
    return rungs[max(bounds)[1]].job_id if bounds else None


def _correlations(rungs: Sequence[Rung]) -> tuple[Correlation, ...]:
    tried = [rung for rung in rungs if rung.success_rate is not None]
    rewarded = [rung for rung in tried if rung.training_reward is not None]
    found = (
        rank_correlation("step", [rung.step for rung in tried], [rung.success_rate or 0.0 for rung in tried]),
        rank_correlation(
            "training reward",
            [rung.training_reward or 0.0 for rung in rewarded],
            [rung.success_rate or 0.0 for rung in rewarded],
        ),
    )
    return tuple(each for each in found if each is not None)


async def _letters(connection: AsyncConnection, jobs: Sequence[AnyRow]) -> Sequence[str | None]:
    """Letters of the rungs, from the goals that two have both tried; None of those that nothing is compared of.

    A ladder is looked at while it runs, so that pairs are told apart by evidence that holds at every look, with Bonferroni's
    share of the chance for each.
    """
    tried = await outcomes.in_order(connection, [row.number for row in jobs]) if 1 < len(jobs) <= MOST_COMPARED else {}
    known = [row.physics for row in jobs if row.physics is not None]
    usual = max(set(known), key=known.count, default=None)
    ended = {
        at: tried[row.number][: row.counted_trials]
        for at, row in enumerate(jobs)
        if tried.get(row.number) and row.physics == usual and not row.physics_mixed
    }
    best_first = sorted(ended, key=lambda at: (-sum(ended[at]) / len(ended[at]), -len(ended[at])))
    chance = pair_chance(len(jobs))

    def differ(one: int, other: int) -> bool:
        pairs = list(zip(ended[best_first[one]], ended[best_first[other]], strict=False))
        return is_decided(pairs.count((True, False)), pairs.count((False, True)), chance)

    told = dict(zip(best_first, letters_where(len(best_first), differ), strict=True)) if len(best_first) > 1 else {}
    return [told.get(at) for at in range(len(jobs))]


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
