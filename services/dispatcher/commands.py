"""Commands to robots: cancel, drain, resume; told again until the robot shows that it heard."""

from dataclasses import dataclass, field

import structlog

from api_schemas.bus import Command, CommandKind
from api_schemas.robot import RobotState
from services.dispatcher.bus import Bus
from services.dispatcher.steps import Steps
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import IN_SERVICE, Fleet

log = structlog.get_logger()
TELL_AGAIN_S = 1.0
"""A command that has had no effect is sent again after so long."""


@dataclass
class Commands:
    """Remembers when it told whom what."""

    bus: Bus
    clock: FarmClock
    fleet: Fleet
    steps: Steps
    timeout_s: float
    _told_s: dict[tuple[str, CommandKind, Claim | None], float] = field(default_factory=dict)

    def tell_wishes(self) -> None:
        """Operators' wishes are repeated until the robot's heartbeat shows them, also to a robot that came anew.

        What is kept of the wish is compared with what the robot says: one that was drained and resumed during a trial says
        only after it that it had heard the first. One that is out of service is told once to test itself again: what it finds
        may keep it there.
        """
        for member in self.fleet.members.values():
            is_there = member.heartbeat is not None and member.lost_s is None and not member.says_that_it_goes
            said = member.heartbeat.state if is_there and member.heartbeat is not None else None
            if member.drain and said in IN_SERVICE:
                self._tell(member.robot, CommandKind.DRAIN, None)
            elif (said == RobotState.DRAINING and not member.drain) or (said == RobotState.OUT_OF_SERVICE and member.test_wanted):
                self._tell(member.robot, CommandKind.RESUME, None)
            elif said is not None and said != RobotState.OUT_OF_SERVICE:
                member.test_wanted = False

    def cancel(self, claim: Claim) -> None:
        """Has the robot stop the attempt."""
        self._tell(claim.robot, CommandKind.CANCEL, claim)

    def _tell(self, robot: str, kind: CommandKind, claim: Claim | None) -> None:
        now_s, key = self.clock.now_s(), (robot, kind, claim)
        self._told_s = {each: at for each, at in self._told_s.items() if 0.0 <= now_s - at < TELL_AGAIN_S}
        if key in self._told_s:
            return
        self._told_s[key] = now_s
        trial_id, fence = (None, None) if claim is None else (claim.trial_id, claim.fence)
        self.steps.start(self._send(robot, Command(kind=kind, trial_id=trial_id, fence=fence)))

    async def _send(self, robot: str, command: Command) -> None:
        reply = await self.bus.command(robot, command, self.timeout_s)
        accepted = reply is not None and reply.accepted
        if accepted and command.kind == CommandKind.RESUME and self._says_out_of_service(robot):
            self.fleet.member(robot).test_wanted = False
        log.info("command sent", robot=robot, kind=str(command.kind), trial=command.trial_id, accepted=accepted)

    def _says_out_of_service(self, robot: str) -> bool:
        said = self.fleet.member(robot).heartbeat
        return said is not None and said.state == RobotState.OUT_OF_SERVICE
