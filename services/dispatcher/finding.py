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
    blocks = 0
    while True:
        row = await queue.oldest_of(tx, robot)
        if row is not None and row.fence == 0:
            return row, row.departure
        if row is not None:
            choice = await queue.choose_again(tx, row, healthy, why)
            if choice.first_choice == robot:
                return row, choice.departure
            continue
        blocks += 1
        if blocks > BLOCKS_AHEAD or await queue.draw(tx, fleet.known(now_s), healthy, why) == 0:
            return await _find_passed_over(tx, robot, now_s, pass_over_s)


async def _find_passed_over(tx: AsyncConnection, robot: str, now_s: float, pass_over_s: float) -> Found | None:
    row = await queue.oldest_of_others(tx, robot)
    if row is None:
        return None
    if row.passed_over_s is None:
        await queue.pass_over(tx, row, now_s)
    if now_s - (row.passed_over_s or now_s) < pass_over_s:
        return None
    return row, f"first choice {row.first_choice} was busy for {pass_over_s:g} s"
