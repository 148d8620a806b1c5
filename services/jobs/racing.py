"""Moves the rungs of a ladder that may give some up: lets the next goals into the queue, and ends rungs that are beaten."""

from collections.abc import Collection, Sequence

from sqlalchemy import select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.ladder import LadderEnds
from services.database.rows import AnyRow
from services.database.tables import job, ladder, rung
from services.jobs import completion, outcomes
from services.jobs.judging import release
from services.jobs.lease import UNENDED
from services.jobs.locking import lock_job
from services.jobs.race import Race, race

_OPEN = (
    select(ladder.c.number, job.c.last_event)
    .join(rung, rung.c.ladder_number == ladder.c.number)
    .join(job, job.c.number == rung.c.job_number)
    .where(ladder.c.is_racing)
    .order_by(ladder.c.number, job.c.number)
)


async def open_ones(connection: AsyncConnection) -> dict[int, tuple[int, ...]]:
    """The numbers of ladders that may give rungs up yet, with the last events of their jobs."""
    found: dict[int, tuple[int, ...]] = {}
    for row in await connection.execute(_OPEN):
        found[row.number] = (*found.get(row.number, ()), row.last_event)
    return found


async def move(tx: AsyncConnection, now_s: float, number: int, robots: Collection[str]) -> Sequence[str]:
    """Brings a ladder forward; gives the ids of the jobs that have ended by it.

    In a transaction that no other dispatcher is in: it takes the rows of all of its jobs, the oldest first.
    """
    shown = (await tx.execute(select(ladder).where(ladder.c.number == number, ladder.c.is_racing))).one_or_none()
    if shown is None:
        return ()
    numbers = select(rung.c.job_number).where(rung.c.ladder_number == number).order_by(rung.c.job_number)
    for each in (await tx.execute(numbers)).scalars().all():
        await lock_job(tx, each)
    wanted = select(job, rung.c.step, rung.c.ordinal).join(rung, rung.c.job_number == job.c.number)
    jobs = (await tx.execute(wanted.where(rung.c.ladder_number == number).order_by(rung.c.step, rung.c.ordinal))).all()
    tried = await outcomes.in_order(tx, [row.number for row in jobs])
    ended = [tried[row.number] for row in jobs]
    stopped = [row.state not in UNENDED or row.cancel_requested for row in jobs]
    stands = race(ended, stopped, jobs[0].trials, LadderEnds(shown.ends))
    over = await _end_rungs(tx, now_s, number, jobs, ended, stands)
    if stands.is_over:
        await tx.execute(update(ladder).where(ladder.c.number == number).values(is_racing=False))
    else:
        ahead = max(1, -(-len(robots) // len(stands.going)))  # as many trials as robots, so that few are wasted
        for place in stands.going:
            await release(tx, jobs[place].number, stands.goals + ahead)
    return over


async def _end_rungs(
    tx: AsyncConnection, now_s: float, number: int, jobs: Sequence[AnyRow], ended: Sequence[Sequence[bool]], stands: Race
) -> list[str]:
    over = []
    for place, row in enumerate(jobs):
        goals = stands.given_up[place]
        if row.state not in UNENDED or row.cancel_requested or (goals is None and not stands.is_over):
            continue
        counted = ended[place][: stands.goals if goals is None else goals]
        if not counted:
            continue
        did = f"{sum(counted)} of {len(counted)} trials reached their goal"
        text = f"{did}; the best rung is known" if goals is None and len(counted) < row.trials else did
        if goals is not None:
            of_rung = (rung.c.ladder_number == number, rung.c.job_number == row.number)
            await tx.execute(update(rung).where(*of_rung).values(given_up=True))
            text = f"given up, since other rungs are better: {did}"
        over.append(await completion.end_judged(tx, now_s, row.number, counted, text))
    return over
