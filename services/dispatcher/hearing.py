"""What the bus says of robots, taken into the fleet; a database row is written only when a process is new."""

from dataclasses import dataclass

import structlog

from api_schemas.bus import Heartbeat, LiveState
from services.database.database import AWAY, Database
from services.dispatcher.bus import Bus
from services.dispatcher.overdue import LeaseEnder
from services.dispatcher.steps import Steps
from services.jobs import robots
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals

log = structlog.get_logger()


@dataclass
class Hearing:
    """Listens on the bus and wakes the dispatcher when something is new."""

    database: Database
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    steps: Steps
    leases: LeaseEnder

    def listen(self, bus: Bus) -> None:
        """Begins to listen; robots that are already there are heard too."""
        bus.on_presence(self._presence_changed)
        bus.on_heartbeat(self._heard)
        bus.on_live_state(self._live)

    def _presence_changed(self, robot: str, present: bool) -> None:
        log.info("robot came" if present else "robot went", robot=robot)
        self.fleet.token_changed(robot, present=present, now_s=self.clock.now_s())
        self.signals.wake_dispatcher(urgent=True)

    async def keep_unkept(self) -> None:
        """Writes down who came while the database was away, now that it answers again.

        What their last processes held was not ended then; it runs out by itself.
        """
        beats = [member.heartbeat for member in self.fleet.members.values() if member.unkept and not member.arriving]
        for beat in beats:
            if beat is not None and beat.instance == self.fleet.member(beat.robot).unkept:
                try:
                    await self._keep(beat)
                except AWAY as error:
                    log.warning("robot not written down", robot=beat.robot, reason=str(error))

    def _heard(self, beat: Heartbeat) -> None:
        now_s = self.clock.now_s()
        new_process = self.fleet.came_anew(beat, now_s)
        if not self.fleet.heard(beat, now_s):
            return
        if new_process:
            member = self.fleet.member(beat.robot)
            member.unkept = member.arriving = beat.instance
            self.steps.start(self._arrives(beat))
        self.signals.wake_dispatcher(urgent=new_process)

    async def _arrives(self, beat: Heartbeat) -> None:
        try:
            await self._came_anew(beat)
        finally:
            if (member := self.fleet.member(beat.robot)).arriving == beat.instance:
                member.arriving = None
            self.signals.wake_dispatcher(urgent=True)

    async def _came_anew(self, beat: Heartbeat) -> None:
        """What the robot's last process was doing has ended."""
        is_new, held = await self._keep(beat)
        member, now_s = self.fleet.member(beat.robot), self.clock.now_s()
        # Where the services alone started anew, an offer may have been lost with the last ones. Of a lease that the same process
        # had accepted, and does not name any more, it is bringing the outcome.
        offer_lost = not self.database.is_shared and not member.lease_accepted
        if member.is_doubled(now_s):
            log.error("robot out of service", robot=beat.robot, reason=member.reason(now_s))
        elif held is not None and (is_new or offer_lost) and (beat.trial_id, beat.fence) != (held.trial_id, held.fence):
            await self.leases.end(held, f"{beat.robot} restarted while it held the lease")

    async def _keep(self, beat: Heartbeat) -> tuple[bool, Claim | None]:
        """Whether nobody had written the process down before, and the attempt that the robot has a lease for."""
        async with self.database.write() as tx:
            is_new = await robots.keep(tx, beat, self.clock.now_s())
            held = await robots.held_by(tx, beat.robot)
        if (member := self.fleet.member(beat.robot)).unkept == beat.instance:
            member.unkept = None
        return is_new, held

    def _live(self, live: LiveState) -> None:
        member = self.fleet.member(live.robot)
        if member.lease == Claim(live.trial_id, live.fence, live.robot):
            member.simulated_s, member.live = live.simulated_s, live
            self.signals.robot_moved(live.robot)
