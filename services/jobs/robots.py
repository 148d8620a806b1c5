"""What the database keeps of robots: who ever joined, the operator's wish to drain, and the leases they hold."""

from sqlalchemy import bindparam, delete, insert, or_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.bus import Heartbeat
from api_schemas.trial import TrialState
from services.database.tables import robot, trial
from services.errors import Conflict, NotFound
from services.jobs import physics
from services.jobs.claim import Claim
from services.jobs.clock import iso
from services.jobs.fleet import Fleet
from services.jobs.lease import ACTIVE

FAULTS_IN_A_ROW = 5
"""A robot on which so many attempts in a row failed by the platform's fault gets no other until an operator says so."""
_OF_ROBOT = update(robot).where(robot.c.robot == bindparam("of_robot"))
_COUNT_DONE = _OF_ROBOT.values(trials_done=robot.c.trials_done + 1, faults_in_a_row=0).returning(robot.c.physics)
_COUNT_FAULT = _OF_ROBOT.values(faults_in_a_row=robot.c.faults_in_a_row + 1).returning(robot.c.faults_in_a_row)
_WITHDRAW = _OF_ROBOT.where(robot.c.withdrawn.is_(None)).values(withdrawn=bindparam("because"))
_ACTIVE_ON = select(trial.c.trial_id, trial.c.fence).where(trial.c.robot == bindparam("of_robot"), trial.c.state.in_(ACTIVE))


async def load(tx: AsyncConnection, fleet: Fleet, now_s: float, lease_s: float, *, prolong: bool) -> None:
    """Puts what the database knows into an empty fleet; ``prolong`` gives open leases their full time again.

    Where one process alone writes, its last clock is gone, and robots need a moment to find this one. Where others write
    too, they have gone on counting.
    """
    await refresh(tx, fleet)
    of_active = select(trial.c.trial_id, trial.c.fence, trial.c.robot, trial.c.state).where(trial.c.state.in_(ACTIVE))
    rows = (await tx.execute(of_active)).all()
    if prolong:
        await tx.execute(update(trial).where(trial.c.state.in_(ACTIVE)).values(lease_until_s=now_s + lease_s))
    for row in rows:
        claim = Claim(row.trial_id, row.fence, row.robot)
        fleet.leased(claim, now_s, accepted=row.state == TrialState.RUNNING)


async def refresh(connection: AsyncConnection, fleet: Fleet) -> None:
    """Puts what the database keeps of the robots into the fleet: wishes of operators, counts, who was withdrawn or forgotten."""
    columns = (robot.c.robot, robot.c.drain, robot.c.trials_done, robot.c.withdrawn)
    rows = (await connection.execute(select(*columns))).all()
    fleet.keep_only({row.robot for row in rows})
    for row in rows:
        member = fleet.member(row.robot)
        member.drain, member.trials_done, member.withdrawn = row.drain, row.trials_done, row.withdrawn


async def keep(tx: AsyncConnection, beat: Heartbeat, now_s: float) -> bool:
    """Writes down a robot that joined or whose process started anew; false when somebody had done so before."""
    told = await physics.told(tx, beat, now_s)
    named = {"instance": beat.instance, "pid": beat.pid, "host": beat.host, "physics": told}
    other = or_(robot.c.instance.is_distinct_from(beat.instance), robot.c.physics.is_distinct_from(told))
    changed = await tx.execute(update(robot).where(robot.c.robot == beat.robot, other).values(**named))
    if changed.rowcount:
        return True
    if (await tx.execute(select(robot.c.robot).where(robot.c.robot == beat.robot))).first() is not None:
        return False
    try:
        async with tx.begin_nested():
            await tx.execute(insert(robot).values(robot=beat.robot, drain=False, first_seen_at=iso(now_s), **named))
    except IntegrityError:
        return False  # another process of the services heard it too
    return True


async def held_by(connection: AsyncConnection, name: str) -> Claim | None:
    """The attempt that the robot has a lease for."""
    row = (await connection.execute(_ACTIVE_ON, {"of_robot": name})).first()
    return None if row is None else Claim(row.trial_id, row.fence, name)


async def count_done(tx: AsyncConnection, name: str) -> int | None:
    """One more outcome of the robot was accepted; gives the number of its physics, None if nobody knows it."""
    return (await tx.execute(_COUNT_DONE, {"of_robot": name})).scalar_one_or_none()


async def count_fault(tx: AsyncConnection, name: str, reason: str) -> None:
    """One more attempt on the robot failed by the platform's fault; too many in a row take it out of service."""
    in_a_row = (await tx.execute(_COUNT_FAULT, {"of_robot": name})).scalar_one_or_none()
    if in_a_row is None or in_a_row < FAULTS_IN_A_ROW:
        return
    because = f"{in_a_row} attempts in a row failed on it, the last because: {reason}; 'trifarm robots resume {name}' tries again"
    await withdraw(tx, name, because)


async def withdraw(tx: AsyncConnection, name: str, because: str) -> None:
    """Takes a robot out of service until an operator resumes it; what it was taken out for first stays what it says."""
    await tx.execute(_WITHDRAW, {"of_robot": name, "because": because})


async def forget(tx: AsyncConnection, name: str) -> None:
    """Keeps nothing more of a robot that is gone for good; its trials keep its name. Should it come back, it joins as a new one.

    Raises:
        NotFound: no robot of this name ever joined.
        Conflict: it has a lease.
    """
    if (held := await held_by(tx, name)) is not None:
        raise Conflict("robot-present", f"{name} has a lease of trial {held.trial_id}; wait until that has ended.")
    if (await tx.execute(delete(robot).where(robot.c.robot == name))).rowcount == 0:
        raise _never_joined(name)


async def wish_drain(tx: AsyncConnection, name: str, *, drain: bool) -> None:
    """Writes down whether the robot shall be drained; one that shall not is tried again if it was withdrawn.

    Raises:
        NotFound: no robot of this name ever joined.
    """
    again = {} if drain else {"faults_in_a_row": 0, "withdrawn": None, "canary_s": None}
    changed = await tx.execute(update(robot).where(robot.c.robot == name).values(drain=drain, **again))
    if changed.rowcount == 0:
        raise _never_joined(name)


def _never_joined(name: str) -> NotFound:
    return NotFound("robot-not-found", f"No robot named {name} ever joined this farm; GET /v1/robots lists them.")
