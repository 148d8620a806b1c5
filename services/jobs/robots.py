"""What the database keeps of robots: who ever joined, the operator's wish to drain, and the leases they hold."""

from sqlalchemy import func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.bus import Heartbeat
from api_schemas.trial import AttemptState, TrialState
from services.database.tables import attempt, robot, trial
from services.errors import NotFound
from services.jobs.claim import Claim
from services.jobs.clock import iso
from services.jobs.fleet import Fleet
from services.jobs.lease import ACTIVE


async def load(tx: AsyncConnection, fleet: Fleet, now_s: float, lease_s: float) -> None:
    """Puts what the database knows into an empty fleet, and gives open leases their full time again.

    The clock of the process that wrote the leases is gone; their robots need a moment to find this one.
    """
    for row in await tx.execute(select(robot.c.robot, robot.c.drain)):
        fleet.member(row.robot).drain = row.drain
    done = select(attempt.c.robot, func.count().label("done")).where(attempt.c.state == AttemptState.ACCEPTED)
    for row in await tx.execute(done.group_by(attempt.c.robot)):
        fleet.member(row.robot).trials_done = row.done
    prolonged = update(trial).where(trial.c.state.in_(ACTIVE)).values(lease_until_s=now_s + lease_s)
    for row in await tx.execute(prolonged.returning(trial.c.trial_id, trial.c.fence, trial.c.robot, trial.c.state)):
        claim = Claim(row.trial_id, row.fence, row.robot)
        fleet.leased(claim, now_s, accepted=row.state == TrialState.RUNNING)


async def keep(tx: AsyncConnection, beat: Heartbeat, now_s: float) -> None:
    """Writes down a robot that joined or whose process started anew."""
    named = {"instance": beat.instance, "pid": beat.pid, "host": beat.host}
    changed = await tx.execute(update(robot).where(robot.c.robot == beat.robot).values(**named))
    if changed.rowcount == 0:
        await tx.execute(insert(robot).values(robot=beat.robot, drain=False, first_seen_at=iso(now_s), **named))


async def wish_drain(tx: AsyncConnection, name: str, *, drain: bool) -> None:
    """Writes down whether the robot shall be drained.

    Raises:
        NotFound: no robot of this name ever joined.
    """
    changed = await tx.execute(update(robot).where(robot.c.robot == name).values(drain=drain))
    if changed.rowcount == 0:
        raise NotFound("robot-not-found", f"No robot named {name} ever joined this farm; GET /v1/robots lists them.")
