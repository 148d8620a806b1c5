"""The next trial for an idle robot: its own first, then what is newly drawn, then what another let wait too long."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow
from services.dispatcher import queue, turns
from services.jobs.fleet import Fleet, Seen
from services.jobs.waiting import robot_now

BLOCKS_AHEAD = 3
"""How many blocks of orders are drawn at most to find a trial for one idle robot."""

Found = tuple[AnyRow, str | None]
"""A queued trial, and why the robot that gets it is not the first of the trial's order."""


@dataclass
class Waiting:
    """What of the queue may still be for somebody in one pass; changes as orders are drawn.

    ``drawn_for`` are robots that trials are drawn for; ``any_undrawn`` says whether others have no order yet.
    """

    drawn_for: set[str]
    any_undrawn: bool = True

    def may_be_for(self, robot: str) -> bool:
        """Whether it is worth while to look for a trial for the robot."""
        return self.any_undrawn or robot in self.drawn_for


def why_unfit(fleet: Fleet, now_s: float) -> queue.Why:
    """Says of a robot what it does instead of being in service."""

    def why(robot: str) -> str:
        member = fleet.snapshot(robot)
        return "was never seen" if member is None else robot_now(member, now_s)

    return why


async def find_trial(
    tx: AsyncConnection, robot: str, seen: Seen, limit: int | None = None, waiting: Waiting | None = None
) -> Found | None:
    """The trial that is for an idle robot now; draws orders as far as is needed to find it.

    Args:
        tx: a transaction that no other dispatcher is in.
        robot: the idle robot.
        seen: the robots as they were a moment ago.
        limit: how many trials a user may have running; None is any number.
        waiting: what the others of this pass know of the queue; it is told for whom trials are drawn, and that nothing is
            left to draw.
    """
    if robot not in seen.healthy:
        return None  # it was lost since it was found idle
    waiting = Waiting(set()) if waiting is None else waiting
    at_limit = await turns.at_limit(tx, limit)
    for rank in await turns.ranks(tx, robot):
        if (found := await _find_of(tx, robot, rank, at_limit, seen, waiting)) is not None:
            return found
    waiting.any_undrawn = await turns.any_undrawn(tx, at_limit)
    waiting.drawn_for.discard(robot)
    return None


async def _find_of(
    tx: AsyncConnection, robot: str, rank: int, at_limit: Sequence[str], seen: Seen, waiting: Waiting
) -> Found | None:
    """The same of one priority, within which users take turns.

    The robot is one of those who were seen in service: a trial that can go to nobody stays with its robot, and if that one were
    asked for anew and were lost meanwhile, it would be found again and again.
    """
    why = why_unfit(seen.fleet, seen.now_s)
    blocks = 0
    while True:
        drawn, undrawn = await turns.next_users(tx, robot, rank, at_limit)
        # Whoever was served longest ago comes next, also if nothing of theirs was drawn for this robot yet.
        if undrawn is not None and blocks < BLOCKS_AHEAD and (drawn is None or undrawn.served_s < drawn.served_s):
            blocks += 1
            waiting.drawn_for |= await queue.draw(tx, rank, undrawn.owner, seen.known, seen.healthy, why)
            continue
        row = None if drawn is None else await queue.oldest_of(tx, robot, rank, drawn.owner)
        if row is None or row.fence == 0:
            return None if row is None else (row, row.departure)
        choice = await queue.choose_again(tx, row, seen.healthy, why)
        if choice.first_choice == robot:
            return row, choice.departure
        if choice.first_choice is not None:
            waiting.drawn_for.add(choice.first_choice)
        # It now waits for another robot, so that it is not found again here.


async def passed_over(
    connection: AsyncConnection, idle: Collection[str], seen: Seen, pass_over_s: float, limit: int | None = None
) -> dict[str, list[Found]]:
    """Trials that waited too long for their busy first choice, by the idle robot that is next in their order, oldest first."""
    found: dict[str, list[Found]] = {}
    if not (seen.busy and idle):
        return found
    at_limit = await turns.at_limit(connection, limit)
    for row in await queue.passed_over(connection, seen.busy, seen.now_s - pass_over_s, at_limit):
        robot = await queue.next_of(connection, row, idle, why_unfit(seen.fleet, seen.now_s))
        if robot is not None:
            found.setdefault(robot, []).append((row, f"first choice {row.first_choice} was busy for {pass_over_s:g} s"))
    return found


async def pass_over(tx: AsyncConnection, seen: Seen, limit: int | None = None) -> None:
    """Notes that idle robots found nothing while trials wait for busy ones; in a transaction that holds nothing else."""
    if seen.busy:
        await queue.pass_over(tx, seen.busy, seen.now_s, await turns.at_limit(tx, limit))
