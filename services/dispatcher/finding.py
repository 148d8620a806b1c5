"""The next trial for an idle robot: its own first, then what is newly drawn, then what another let wait too long."""

from collections.abc import Collection, Sequence

from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow
from services.dispatcher import queue, turns
from services.jobs.fleet import Fleet
from services.jobs.waiting import robot_now

BLOCKS_AHEAD = 3
"""How many blocks of orders are drawn at most to find a trial for one idle robot."""

Found = tuple[AnyRow, str | None]
"""A queued trial, and why the robot that gets it is not the first of the trial's order."""


def why_unfit(fleet: Fleet, now_s: float) -> queue.Why:
    """Says of a robot what it does instead of being in service."""

    def why(robot: str) -> str:
        member = fleet.snapshot(robot)
        return "was never seen" if member is None else robot_now(member, now_s)

    return why


async def find_trial(tx: AsyncConnection, robot: str, fleet: Fleet, now_s: float, limit: int | None = None) -> Found | None:
    """The trial that is for an idle robot now; draws orders as far as is needed to find it.

    Args:
        tx: a transaction that no other dispatcher is in.
        robot: the idle robot.
        fleet: as it is seen now.
        now_s: now.
        limit: how many trials a user may have running; None is any number.
    """
    healthy = fleet.healthy(now_s)
    if robot not in healthy:
        return None  # it was lost since it was found idle
    at_limit = await turns.at_limit(tx, limit)
    for rank in await turns.ranks(tx, robot):
        if (found := await _find_of(tx, robot, rank, at_limit, healthy, fleet, now_s)) is not None:
            return found
    return None


async def _find_of(
    tx: AsyncConnection,
    robot: str,
    rank: int,
    at_limit: Sequence[str],
    healthy: Collection[str],
    fleet: Fleet,
    now_s: float,
) -> Found | None:
    """The same of one priority, within which users take turns.

    Who is ``healthy`` is asked once before, and the robot is one of them: a trial that can go to nobody stays with its robot,
    and if that one were lost meanwhile, it would be found again and again.
    """
    why = why_unfit(fleet, now_s)
    blocks = 0
    while True:
        drawn = await turns.next_with_drawn(tx, robot, rank, at_limit)
        undrawn = await turns.next_with_undrawn(tx, rank, at_limit) if blocks < BLOCKS_AHEAD else None
        # Whoever was served longest ago comes next, also if nothing of theirs was drawn for this robot yet.
        if undrawn is not None and (drawn is None or undrawn.served_s < drawn.served_s):
            blocks += 1
            await queue.draw(tx, rank, undrawn.owner, fleet.known(now_s), healthy, why)
            continue
        row = None if drawn is None else await queue.oldest_of(tx, robot, rank, drawn.owner)
        if row is None or row.fence == 0:
            return None if row is None else (row, row.departure)
        choice = await queue.choose_again(tx, row, healthy, why)
        if choice.first_choice == robot:
            return row, choice.departure
        # It now waits for another robot, so that it is not found again here.


async def find_passed_over(
    tx: AsyncConnection, robot: str, fleet: Fleet, now_s: float, pass_over_s: float, limit: int | None = None
) -> Found | None:
    """A trial that waited too long for its busy first choice, if the robot is the next idle one of the trial's order."""
    if not (busy := _busy(robot, fleet, now_s)):
        return None
    idle = {robot, *fleet.ready(now_s)}
    for row in await queue.passed_over(tx, busy, now_s - pass_over_s, await turns.at_limit(tx, limit)):
        if await queue.next_of(tx, row, idle, why_unfit(fleet, now_s)) == robot:
            return row, f"first choice {row.first_choice} was busy for {pass_over_s:g} s"
    return None


async def pass_over(tx: AsyncConnection, robot: str, fleet: Fleet, now_s: float, limit: int | None = None) -> None:
    """Notes that the robot found nothing while trials wait for busy ones; in a transaction that holds nothing else."""
    if busy := _busy(robot, fleet, now_s):
        await queue.pass_over(tx, busy, now_s, await turns.at_limit(tx, limit))


def _busy(robot: str, fleet: Fleet, now_s: float) -> frozenset[str]:
    """Who is in service and not idle: those who are idle take what is theirs in this same pass."""
    if robot not in (healthy := fleet.healthy(now_s)):
        return frozenset()
    return healthy - {robot, *fleet.ready(now_s)}
