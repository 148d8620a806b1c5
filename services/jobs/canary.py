"""The canary: a known policy that every robot tries while it is idle, and what becomes of one that does too badly at it.

There is one canary or none. Its jobs are pinned to one robot, wait behind everything else, and carry the band that held when
they were queued, so that a band changed meanwhile judges nobody by surprise.
"""

from collections.abc import Collection, Sequence

from sqlalchemy import delete, insert, or_, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.canary import Canary, CanaryRequest
from api_schemas.job import JobPriority, JobRequest, TaskName
from api_schemas.success_rate import wilson
from services.database.rows import AnyRow
from services.database.tables import canary, policy, robot
from services.errors import NotFound
from services.jobs import robots, submission
from services.jobs.clock import iso
from services.policies import owners

OWNER = "farm:canary"
"""Whose turn it is at a robot when a trial of the canary is next; a name that no token can have."""
LEVEL = 0.80
_ONLY = 1
_WANTED = select(canary, policy.c.name.label("policy_name")).join(policy, policy.c.digest == canary.c.policy)


async def choose(tx: AsyncConnection, now_s: float, request: CanaryRequest, set_by: str) -> None:
    """Makes this the farm's canary; every robot tries it when it is next idle.

    Raises:
        NotFound: the policy was not uploaded.
    """
    if await owners.find(tx, request.policy, None) is None:
        raise NotFound("policy-not-found", f"No policy has the digest {request.policy}; upload it first with POST /v1/policies.")
    await withdraw(tx)
    values = request.model_dump() | {"seed": submission.draw_seed(), "set_by": set_by, "set_at": iso(now_s)}
    await tx.execute(insert(canary).values(number=_ONLY, **values))
    await tx.execute(update(robot).values(canary_s=None))


async def withdraw(tx: AsyncConnection) -> None:
    """The farm has no canary any more; its jobs that are queued go on."""
    await tx.execute(delete(canary))


async def chosen(connection: AsyncConnection) -> Canary:
    """The farm's canary.

    Raises:
        NotFound: there is none.
    """
    row = (await connection.execute(_WANTED)).one_or_none()
    if row is None:
        raise NotFound("canary-not-set", "This farm has no canary; an operator sets one with PUT /v1/canary.")
    return Canary.model_validate({name: value for name, value in row._mapping.items() if name != "number"})


async def due(connection: AsyncConnection, now_s: float, idle: Collection[str]) -> Sequence[str]:
    """Those of the idle robots whose last look at the canary is too long ago; nobody where there is no canary."""
    every = select(canary.c.every_s).scalar_subquery()
    late = or_(robot.c.canary_s.is_(None), robot.c.canary_s <= now_s - every)
    wanted = select(robot.c.robot).where(every.is_not(None), robot.c.robot.in_(list(idle)), late).order_by(robot.c.robot)
    return (await connection.execute(wanted)).scalars().all()


async def queue(tx: AsyncConnection, now_s: float, name: str) -> str | None:
    """Queues the canary's job for a robot and gives its id; None when another process has done so, or there is no canary now."""
    row = (await tx.execute(_WANTED)).one_or_none()
    if row is None:
        return None
    late = or_(robot.c.canary_s.is_(None), robot.c.canary_s <= now_s - row.every_s)
    if (await tx.execute(update(robot).where(robot.c.robot == name, late).values(canary_s=now_s))).rowcount == 0:
        return None
    wish = JobRequest(policy=row.policy, task=TaskName(row.task), trials=row.trials, seed=row.seed, priority=JobPriority.LOW)
    pinned = {"robot": name, "canary_at_least": row.at_least}
    job_id, _ = await submission.submit(tx, now_s, wish, submission.Sender(OWNER), pinned=pinned)
    return job_id


async def judge(tx: AsyncConnection, ended: AnyRow) -> None:
    """Takes the robot of a canary's job that has ended out of service, if its success has left the band."""
    if ended.canary_at_least is None:
        return
    if (because := left_band(ended.successes, ended.trials_done, ended.canary_at_least)) is not None:
        what = f"its canary ({ended.policy_name}, {ended.task}, job {ended.job_id}) {because}"
        await robots.withdraw(tx, ended.robot, f"{what}; 'trifarm robots resume {ended.robot}' tries again")


def left_band(successes: int, trials: int, at_least: float) -> str | None:
    """Why so many successes are too few for a band that begins at ``at_least``; None when they are not.

    They are when the whole interval lies below: of robots right at the edge one in ten looks so by chance, of better ones fewer.
    """
    low, high = wilson(successes, trials, LEVEL)
    if high >= at_least:
        return None
    rate = f"{successes} of {trials} trials (80 %: {100 * low:.0f} to {100 * high:.0f} %)"
    return f"succeeded in {rate}, and the band of sound robots begins at {100 * at_least:g} %"
