"""Moves the jobs of an open question: lets the next goals into the queue, and ends the jobs once the answer is known."""

import json
from collections.abc import Collection, Sequence
from dataclasses import replace

from sqlalchemy import bindparam, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import EventKind, JobState
from api_schemas.question import Verdict
from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.database.tables import question, trial
from services.jobs import completion, events
from services.jobs.clock import iso
from services.jobs.lease import UNENDED
from services.jobs.locking import lock_job
from services.jobs.questions import Standing, standing

NOTHING_TO_COMPARE = "the job that it is compared with has ended without its first trial"
_RELEASE = (
    update(trial)
    .where(
        trial.c.job_number == bindparam("of_job"),
        trial.c.state == TrialState.HELD,
        trial.c.ordinal < bindparam("before"),
    )
    .values(state=TrialState.QUEUED)
)
_FOLLOW = (
    update(trial)
    .where(
        trial.c.job_number == bindparam("of_job"),
        trial.c.ordinal == bindparam("at"),
        trial.c.state.in_((TrialState.QUEUED, TrialState.HELD)),
        trial.c.fence == 0,
    )
    .values(robot_order=bindparam("to_order"), first_choice=None, departure=None, passed_over_s=None)
)


async def move(tx: AsyncConnection, now_s: float, job_number: int, robots: Collection[str]) -> Sequence[str]:
    """Brings a question forward; gives the ids of the jobs that have ended by it.

    In a transaction that no other dispatcher is in: it takes the rows of both jobs, the older first.

    Args:
        tx: such a transaction.
        now_s: now.
        job_number: of the job that the question is about.
        robots: in service; as many goals are under way at most, so that few are wasted once the answer is known.
    """
    row = (await tx.execute(select(question).where(question.c.job_number == job_number, question.c.verdict.is_(None)))).first()
    if row is None:
        return ()
    for number in sorted({job_number, row.against_number or job_number}):
        await lock_job(tx, number)
    stands = await standing(tx, row)
    if stands.job.state not in UNENDED or stands.job.cancel_requested:
        return await _give_up(tx, now_s, stands)
    if stands.verdict is not None:
        return await _settle(tx, now_s, stands)
    await _go_on(tx, stands, robots)
    return ()


async def _go_on(tx: AsyncConnection, stands: Standing, robots: Collection[str]) -> None:
    """Puts the next goals into the queue of both jobs, each for one robot."""
    before = stands.ready + max(2, len(robots))
    for number in _own(stands):
        await release(tx, number, before)
    if stands.other is not None:
        await _follow(tx, stands, before)


async def release(tx: AsyncConnection, number: int, before: int) -> None:
    """Lets the trials of a job's first goals into the queue."""
    await tx.execute(_RELEASE, {"of_job": number, "before": before})


async def _follow(tx: AsyncConnection, stands: Standing, before: int) -> None:
    """Sends the trials of goals that one policy has tried, or is trying, to the same robot with the other."""
    assert stands.other is not None, "there is another job"
    numbers = (stands.job.number, stands.other.number)
    columns = (trial.c.job_number, trial.c.ordinal, trial.c.robot, trial.c.robot_order, trial.c.fence)
    within = (trial.c.ordinal >= stands.ready, trial.c.ordinal < before)
    rows = (await tx.execute(select(*columns).where(trial.c.job_number.in_(numbers), *within))).all()
    at = {(row.job_number, row.ordinal): row for row in rows}
    for row in rows:
        partner = at.get((numbers[1] if row.job_number == numbers[0] else numbers[0], row.ordinal))
        if row.robot is None or partner is None or partner.robot is not None or _first(partner) == row.robot:
            continue
        order = [row.robot, *(robot for robot in json.loads(partner.robot_order) if robot != row.robot)]
        followed = {"of_job": partner.job_number, "at": row.ordinal, "to_order": json.dumps(order)}
        await tx.execute(_FOLLOW, followed)


def _first(row: AnyRow) -> str | None:
    return next(iter(json.loads(row.robot_order)), None)


async def _settle(tx: AsyncConnection, now_s: float, stands: Standing) -> Sequence[str]:
    """The answer is known, or cannot be found any more."""
    if stands.counted == 0:
        await _decide(tx, stands, Verdict.UNDECIDED)
        await completion.give_up(tx, now_s, stands.job.number, NOTHING_TO_COMPARE)
        return (stands.job.job_id,)
    verdict = stands.verdict if stands.is_of_one_physics else Verdict.UNDECIDED
    assert verdict is not None, "it is settled only with a verdict"
    await _decide(tx, stands, verdict)
    text = replace(stands, verdict=verdict).shown.sentence
    ended = []
    for number, done in zip(_own(stands), (stands.this_ended, stands.other_ended), strict=False):
        successes = [each.succeeded for each in done[: stands.counted]]
        ended.append(await completion.end_judged(tx, now_s, number, successes, text))
    return ended


async def _give_up(tx: AsyncConnection, now_s: float, stands: Standing) -> Sequence[str]:
    """The job was cancelled or has failed; so the one that was queued for it is cancelled, too."""
    await _decide(tx, stands, Verdict.UNDECIDED)
    twin = stands.other
    if twin is None or not stands.row.is_twin or twin.state not in UNENDED or twin.cancel_requested:
        return ()
    if stands.job.state == JobState.FAILED:
        reason = f"job {stands.job.job_id}, which it was queued for, has failed"
        await completion.give_up(tx, now_s, twin.number, reason)
        return (twin.job_id,)
    await completion.cancel_queued(tx, twin.number)
    text = f"cancelled with job {stands.job.job_id}, which it was queued for"
    now = await events.record(tx, iso(now_s), twin.number, EventKind.JOB_CANCELLING, text, cancel=True)
    await completion.end_cancelled(tx, now_s, now)
    return (twin.job_id,)


async def _decide(tx: AsyncConnection, stands: Standing, verdict: Verdict) -> None:
    await tx.execute(update(question).where(question.c.job_number == stands.job.number).values(verdict=verdict))


def _own(stands: Standing) -> tuple[int, ...]:
    """The numbers of the jobs that the question moves and ends: its own, and the one that was queued for it."""
    twin = stands.other if stands.row.is_twin else None
    if twin is None or twin.state not in UNENDED:
        return (stands.job.number,)
    return (stands.job.number, twin.number)
