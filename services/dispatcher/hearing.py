"""What the bus says of robots, taken into the fleet; a database row is written only when a process is new."""

import asyncio
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import structlog
from sqlalchemy.exc import DBAPIError

from api_schemas.bus import Heartbeat, LiveState
from services.database.database import AWAY, Database, is_of_value
from services.dispatcher.bus import Bus
from services.dispatcher.overdue import LeaseEnder
from services.dispatcher.steps import Steps
from services.jobs import robots
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals

log = structlog.get_logger()
GATHER_S = 0.1
"""Robots that come within so long are written down together, and those that come or go are told in one line."""
NAMED = 8


@dataclass
class Hearing:
    """Listens on the bus and wakes the dispatcher when something is new; owns what it has not written down or told yet."""

    database: Database
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    steps: Steps
    leases: LeaseEnder
    _arriving: dict[str, Heartbeat] = field(default_factory=dict)
    _changed: defaultdict[bool, list[str]] = field(default_factory=lambda: defaultdict(list))

    def listen(self, bus: Bus) -> None:
        """Begins to listen; robots that are already there are heard too."""
        bus.on_presence(self._presence_changed)
        bus.on_heartbeat(self._heard)
        bus.on_live_state(self._live)

    def _presence_changed(self, robot: str, present: bool) -> None:
        self.fleet.token_changed(robot, present=present, now_s=self.clock.now_s())
        if not any(self._changed.values()):
            asyncio.get_running_loop().call_later(GATHER_S, self._tell_changed)
        self._changed[present].append(robot)

    def _tell_changed(self) -> None:
        changed, self._changed = self._changed, defaultdict(list)
        for present, names in changed.items():
            log.info("robots came" if present else "robots went", count=len(names), robots=names[:NAMED])
        self.signals.wake_dispatcher(urgent=True)

    async def keep_unkept(self) -> None:
        """Writes down who came while the database was away, now that it answers again.

        What their last processes held was not ended then; it runs out by itself.
        """
        beats = [member.heartbeat for member in self.fleet.members.values() if member.unkept and not member.arriving]
        unkept = [beat for beat in beats if beat is not None and beat.instance == self.fleet.member(beat.robot).unkept]
        if unkept:
            try:
                await self._keep(unkept)
            except AWAY as error:
                log.warning("robots not written down", robots=[beat.robot for beat in unkept][:NAMED], reason=str(error))

    def _heard(self, beat: Heartbeat) -> None:
        now_s = self.clock.now_s()
        new_process = self.fleet.came_anew(beat, now_s)
        if not self.fleet.heard(beat, now_s):
            return
        if new_process:
            member = self.fleet.member(beat.robot)
            member.unkept = member.arriving = beat.instance
            if not self._arriving:
                self.steps.start(self._arrive())
            self._arriving[beat.robot] = beat
        else:
            self.signals.wake_dispatcher()

    async def _arrive(self) -> None:
        """Takes in all that came within a moment; what their last processes were doing has ended."""
        await asyncio.sleep(GATHER_S)
        arriving, self._arriving = list(self._arriving.values()), {}
        try:
            for beat, is_new, held in await self._keep(arriving):
                await self._end_last(beat, held, is_new=is_new)
        finally:
            for beat in arriving:
                if (member := self.fleet.member(beat.robot)).arriving == beat.instance:
                    member.arriving = None
            self.signals.wake_dispatcher(urgent=True)

    async def _end_last(self, beat: Heartbeat, held: Claim | None, *, is_new: bool) -> None:
        member, now_s = self.fleet.member(beat.robot), self.clock.now_s()
        # Where the services alone started anew, an offer may have been lost with the last ones. Of a lease that the same process
        # had accepted, and does not name any more, it is bringing the outcome.
        offer_lost = not self.database.is_shared and not member.lease_accepted
        if member.is_doubled(now_s):
            log.error("robot out of service", robot=beat.robot, reason=member.reason(now_s))
        elif held is not None and (is_new or offer_lost) and (beat.trial_id, beat.fence) != (held.trial_id, held.fence):
            did = "restarted while it held the lease" if is_new else "has no such trial"
            await self.leases.end(held, f"{beat.robot} {did}", never_offered=not is_new)

    async def _keep(self, beats: Sequence[Heartbeat]) -> Sequence[tuple[Heartbeat, bool, Claim | None]]:
        """Of each whether nobody had written the process down before, and the attempt that the robot has a lease for."""
        try:
            async with self.database.write() as tx:
                new = await robots.keep(tx, beats, self.clock.now_s())
                held = await robots.held_by(tx, [beat.robot for beat in beats])
        except DBAPIError as error:
            if not is_of_value(error):
                raise
            if len(beats) > 1:  # what one of them says cannot be kept
                return [kept for beat in beats for kept in await self._keep([beat])]
            log.warning("robot not written down", robot=beats[0].robot, reason=str(error.orig))
            return []
        for beat in beats:
            if (member := self.fleet.member(beat.robot)).unkept == beat.instance:
                member.unkept = None
        return [(beat, beat.robot in new, held.get(beat.robot)) for beat in beats]

    def _live(self, live: LiveState) -> None:
        member = self.fleet.member(live.robot)
        if member.lease == Claim(live.trial_id, live.fence, live.robot):
            member.simulated_s, member.live = live.simulated_s, live
            self.signals.robot_moved(live.robot)
