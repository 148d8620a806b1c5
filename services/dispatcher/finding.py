"""The next trial for an idle robot: its own first, then what is newly drawn, then what another let wait too long."""

from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow
from services.dispatcher import queue
from services.jobs.fleet import Fleet
from services.jobs.waiting import robot_now

BLOCKS_AHEAD = 3
"""How many blocks of orders are drawn to find a trial for one idle robot."""

Found = tuple[AnyRow, str | None]
"""A queued trial, and why the robot that gets it is not the first of the trial's order."""


def why_unfit(fleet: Fleet, now_s: float) -> queue.Why:
    """Says of a robot what it does instead of being in service."""

    def why(robot: str) -> str:
        member = fleet.snapshot(robot)
        return "was never seen" if member is None else robot_now(member, now_s)

    return why


async def find_trial(tx: AsyncConnection, robot: str, fleet: Fleet, now_s: float, pass_over_s: float) -> Found | None:
    """The trial that an idle robot gets now; draws orders as far as is needed to find it."""
    healthy, why = fleet.healthy(now_s), why_unfit(fleet, now_s)
    if robot not in healthy:
        return None  # it was lost since it was found idle
    blocks = 0
    while blocks <= BLOCKS_AHEAD:
        row = await queue.oldest_of(tx, robot)
        if row is not None and row.fence == 0:
            return row, row.departure
        if row is not None:
            choice = await queue.choose_again(tx, row, healthy, why)
            if choice.first_choice == robot:
                return row, choice.departure
            continue  # it now waits for another robot, so that it is not found again here
        blocks += 1
        if blocks > BLOCKS_AHEAD or await queue.draw(tx, fleet.known(now_s), healthy, why) == 0:
            break
    return await _find_passed_over(tx, robot, fleet, now_s, pass_over_s)


async def _find_passed_over(tx: AsyncConnection, robot: str, fleet: Fleet, now_s: float, pass_over_s: float) -> Found | None:
    """A trial that waited too long for its busy first choice, if the robot is the next idle one of the trial's order."""
    idle = {robot, *fleet.ready(now_s)}
    # Those who are idle take what is theirs in this same pass.
    if not (busy := fleet.healthy(now_s) - idle):
        return None
    await queue.pass_over(tx, busy, now_s)
    for row in await queue.passed_over(tx, busy, now_s - pass_over_s):
        if await queue.next_of(tx, row, idle, why_unfit(fleet, now_s)) == robot:
            return row, f"first choice {row.first_choice} was busy for {pass_over_s:g} s"
    return None
