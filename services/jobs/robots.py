"""What the database keeps of robots: who ever joined, the operator's wish to drain, and the leases they hold."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import bindparam, delete, insert, or_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.bus import Heartbeat
from api_schemas.trial import TrialState
from services.database.postgres import dispatch_alone
from services.database.rows import AnyRow
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
_ACTIVE_ON = select(trial.c.trial_id, trial.c.fence, trial.c.robot).where(
    trial.c.robot.in_(bindparam("of_robots", expanding=True)), trial.c.state.in_(ACTIVE)
)
_TOLD = ("instance", "pid", "host", "physics")
_NAME = _OF_ROBOT.where(
    or_(*(robot.c[name].is_distinct_from(bindparam(f"to_{name}")) for name in ("instance", "physics")))
).values({name: bindparam(f"to_{name}") for name in _TOLD})
_JOIN = insert(robot)
_OF_FLEET = (robot.c.robot, robot.c.drain, robot.c.withdrawn)
_HELD_BACK = select(*_OF_FLEET).where(or_(robot.c.drain.is_(True), robot.c.withdrawn.is_not(None)))
_NOTHING_SAID = (False, None)


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
    wishes, rows = fleet.wishes, (await connection.execute(select(*_OF_FLEET, robot.c.trials_done))).all()
    fleet.keep_only({row.robot for row in rows})
    for row in rows:
        fleet.member(row.robot).trials_done = row.trials_done
    _take_wishes(fleet, rows, wishes)


async def refresh_wishes(connection: AsyncConnection, fleet: Fleet) -> None:
    """The part of it that others must see soon, read of those few whom it concerns."""
    wishes = fleet.wishes
    _take_wishes(fleet, (await connection.execute(_HELD_BACK)).all(), wishes)


def _take_wishes(fleet: Fleet, rows: Sequence[AnyRow], wishes: int) -> None:
    if fleet.wishes != wishes:
        return  # what was read may be older than a wish; the next look has it
    said = {row.robot: (row.drain, row.withdrawn) for row in rows}
    for member in fleet.members.values():
        member.drain, member.withdrawn = said.get(member.robot, _NOTHING_SAID)


async def keep(tx: AsyncConnection, beats: Sequence[Heartbeat], now_s: float) -> frozenset[str]:
    """Writes down robots that joined or whose process started anew; gives those of whom nobody had done so before."""
    known_of = select(robot.c.robot, robot.c.instance, robot.c.physics).where(robot.c.robot.in_([beat.robot for beat in beats]))
    known = {row.robot: (row.instance, row.physics) for row in await tx.execute(known_of)}
    told: dict[tuple[str, ...], int | None] = {}
    joined: list[dict[str, Any]] = []
    changed: list[dict[str, Any]] = []
    for beat in beats:
        if (what := (beat.physics, beat.physics_digest, beat.form)) not in told:
            told[what] = await physics.told(tx, beat, now_s)
        row = {"instance": beat.instance, "pid": beat.pid, "host": beat.host, "physics": told[what]}
        if beat.robot not in known:
            joined.append({"robot": beat.robot, "drain": False, "first_seen_at": iso(now_s)} | row)
        elif known[beat.robot] != (beat.instance, told[what]):
            changed.append({"of_robot": beat.robot} | {f"to_{name}": value for name, value in row.items()})
    # Of several who hear the same, one changes the row.
    anew = [row["of_robot"] for row in changed if (await tx.execute(_NAME, row)).rowcount]
    return frozenset({*anew, *await _join(tx, joined)})


async def _join(tx: AsyncConnection, rows: Sequence[dict[str, Any]]) -> Sequence[str]:
    """Those of whom no other process of the services has heard at the same time."""
    if not rows:
        return ()
    try:
        async with tx.begin_nested():
            await tx.execute(_JOIN, rows)
    except IntegrityError:
        return () if len(rows) == 1 else [name for row in rows for name in await _join(tx, [row])]
    return [row["robot"] for row in rows]


async def held_by(connection: AsyncConnection, names: Sequence[str]) -> dict[str, Claim]:
    """The attempts that these robots have leases for."""
    rows = await connection.execute(_ACTIVE_ON, {"of_robots": names})
    return {row.robot: Claim(row.trial_id, row.fence, row.robot) for row in rows}


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
    if (held := (await held_by(tx, [name])).get(name)) is not None:
        raise Conflict("robot-present", f"{name} has a lease of trial {held.trial_id}; wait until that has ended.")
    if (await tx.execute(delete(robot).where(robot.c.robot == name))).rowcount == 0:
        raise _never_joined(name)


async def forget_those_without_a_lease(tx: AsyncConnection, names: Sequence[str]) -> None:
    """The same of several robots; who has a lease, or is forgotten already, is passed over."""
    free = set(names) - (await held_by(tx, names)).keys()
    await tx.execute(delete(robot).where(robot.c.robot.in_(free)))


async def wish_drain(tx: AsyncConnection, name: str, *, drain: bool) -> None:
    """Writes down whether the robot shall be drained; one that shall not is tried again if it was withdrawn.

    Raises:
        NotFound: no robot of this name ever joined.
    """
    await dispatch_alone(tx)  # leases that are being written are there when this returns, and later ones see the wish
    again = {} if drain else {"faults_in_a_row": 0, "withdrawn": None, "canary_s": None}
    changed = await tx.execute(update(robot).where(robot.c.robot == name).values(drain=drain, **again))
    if changed.rowcount == 0:
        raise _never_joined(name)


def _never_joined(name: str) -> NotFound:
    return NotFound("robot-not-found", f"No robot named {name} ever joined this farm; GET /v1/robots lists them.")
