"""Gives idle robots the trials that are for them, some at a time, for as long as others can wait."""

import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

from prometheus_client import Histogram
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.database import Database
from services.database.rows import AnyRow
from services.dispatcher import queue
from services.dispatcher.finding import Found, Waiting, find_trial, pass_over, passed_over
from services.jobs import lease
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet, Seen
from services.jobs.signals import Signals
from services.settings import Settings

AT_MOST_S = 0.5
"""For so long leases are given before the dispatcher looks at those that run; a thousand robots may have come at once."""
FEW = 8
"""For so few idle robots a trial is looked for without more ado; of more it is read first for whom there is anything."""
AT_ONCE = 8
"""For so many robots leases are written in one transaction: what waits to write meanwhile waits some milliseconds for each."""
Alone = Callable[..., AbstractAsyncContextManager[AsyncConnection]]


@dataclass
class Giver:
    """Writes leases for idle robots; owns whose turn it was last.

    ``alone`` opens a transaction that no other dispatcher is in, ``offer`` begins to offer a lease that is written.
    """

    settings: Settings
    database: Database
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    alone: Alone
    offer: Callable[[Claim, AnyRow], None]
    claim_s: Histogram
    _last: str = ""

    async def give(self, seen: Seen) -> bool:
        """Gives each idle robot a trial, as far as there are any for it; if it takes long, the next time goes on from there.

        Gives whether any got one.
        """
        ends_s, limit = time.monotonic() + AT_MOST_S, self.settings.user_trials_at_once
        waiting, left = await self._waiting(seen.ready), []
        for robots in _parts(_in_turn(seen.ready, self._last), AT_ONCE):
            given = await self._give(robots, seen, limit, waiting)
            left += [robot for robot in robots if robot not in given]
            self._last = robots[-1]
            if time.monotonic() > ends_s:
                self.signals.wake_dispatcher()
                break
        if left and seen.busy:
            await self._give_passed_over(left, seen, limit)
        return any(self.fleet.member(robot).lease is not None for robot in seen.ready)

    async def _waiting(self, idle: Sequence[str]) -> Waiting:
        if len(idle) <= FEW:
            return Waiting(set(idle))
        async with self.database.read() as connection:
            return Waiting(await queue.drawn_robots(connection))

    async def _give(self, robots: Sequence[str], seen: Seen, limit: int | None, waiting: Waiting) -> Collection[str]:
        """Writes leases for those robots that there is a trial for, all in one transaction; gives who has one."""
        given, rest = set[str](), deque(robots)
        while any(waiting.may_be_for(robot) for robot in rest):
            began_s = time.monotonic()
            async with self.alone() as tx:
                # A refused lease would have cost its user the turn.
                cannot = await lease.who_cannot(tx, rest)
                rest = deque(robot for robot in rest if robot not in cannot)
                found = await self._find(tx, rest, seen, limit, waiting)
                claims = await self._write(tx, found)
            for claim, row in claims:
                self.claim_s.observe((time.monotonic() - began_s) / len(claims))
                self._given(claim, row)
                given.add(claim.robot)
        return given

    async def _find(
        self, tx: AsyncConnection, rest: deque[str], seen: Seen, limit: int | None, waiting: Waiting
    ) -> dict[str, Found]:
        """Trials for the robots, in whose rest it leaves those that come when these leases are written.

        A trial that is drawn for a robot is found for no other, so that its job need not be held while the next is looked for.
        But with the first lease of a job that may go to any robot all its trials go to that one, and a limit counts leases.
        """
        found = dict[str, Found]()
        while rest:
            robot = rest.popleft()
            trial = await find_trial(tx, robot, seen, limit, waiting) if waiting.may_be_for(robot) else None
            if trial is None:
                continue
            found[robot] = trial
            await lease.end_turn(tx, self.clock.now_s(), trial[0].owner)
            if _is_last(trial[0], limit):
                break
        return found

    async def _write(self, tx: AsyncConnection, found: Mapping[str, Found]) -> Sequence[tuple[Claim, AnyRow]]:
        leases, claims = self._leases(tx), []
        for robot, (row, departure) in sorted(found.items(), key=lambda each: each[1][0].job_number):
            if (claim := await leases.write(row, robot, departure)) is not None:
                claims.append((claim, row))
        await leases.finish()
        return claims

    async def _give_passed_over(self, left: Sequence[str], seen: Seen, limit: int | None) -> None:
        """What waited too long for busy robots goes to those who have nothing of their own; the rest begins to wait."""
        async with self.database.read() as connection:
            found = await passed_over(connection, left, seen, self.settings.pass_over_s, limit)
        for robot, (first, *_) in found.items():
            async with self.alone() as tx:
                claims = await self._write(tx, {robot: first})
                if claims:
                    await lease.end_turn(tx, self.clock.now_s(), first[0].owner)
            for claim, row in claims:
                self._given(claim, row)
                self.signals.wake_dispatcher()  # others may come next for the rest
            if claims and _is_last(first[0], limit):
                return  # what was read of the others may not hold any more
        async with self.alone(lasting=False) as tx:
            await pass_over(tx, seen, limit)

    def _leases(self, tx: AsyncConnection) -> lease.Leases:
        return lease.Leases(tx, self.clock.now_s(), self.settings.lease_s)

    def _given(self, claim: Claim, row: AnyRow) -> None:
        self.fleet.leased(claim, self.clock.now_s())
        self.signals.tell_others(row.job_id)
        self.offer(claim, row)


def _is_last(row: AnyRow, limit: int | None) -> bool:
    """Whether what others may get depends on this lease: the job's trials all go to its robot, or its user has a limit."""
    return row.any_robot or limit is not None


def _in_turn(robots: Sequence[str], last: str) -> Sequence[str]:
    """The robots in the order of their names, those behind ``last`` first."""
    behind = bisect_right(robots, last)
    return (*robots[behind:], *robots[:behind])


def _parts(robots: Sequence[str], size: int) -> Iterator[Sequence[str]]:
    return (robots[start : start + size] for start in range(0, len(robots), size))
