"""The robots as they are seen right now: presence and heartbeats from the bus, leases as last written to the database."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from operator import attrgetter

from api_schemas.bus import Heartbeat, LiveState
from api_schemas.robot import RobotState
from services.jobs.claim import Claim

SILENT_AFTER_S = 10.0
"""A robot whose token stands but whose heartbeats have stopped for so long counts as lost."""
RETURN_AFTER_S = 2.0
"""Heartbeats this long after the token went show that the robot is back; earlier ones may have been under way."""
KNOWN_AFTER_LOSS_S = 60.0
"""A lost robot takes part in draws for so long, because most come back."""
IN_SERVICE = frozenset({RobotState.IDLE, RobotState.LEASED, RobotState.RUNNING})
"""States of robots that are idle or busy."""
_SAID = attrgetter(*(name for name in Heartbeat.model_fields if name != "health"))
"""What a heartbeat says but for what changes each time and concerns nobody who gives leases."""


@dataclass
class Member:
    """One robot. ``lease`` is what the database gave it; ``heartbeat`` what it last said of itself."""

    robot: str
    heartbeat: Heartbeat | None = None
    seen_s: float = 0.0
    present: bool = False
    lost_s: float | None = None
    drain: bool = False
    """An operator wants it to take no further trial, as the database has it."""
    test_wanted: bool = False
    """An operator wants it, out of service, to test itself again."""
    withdrawn: str | None = None
    """Why the farm took it out of service; it may itself think that it is well."""
    lease: Claim | None = None
    lease_accepted: bool = False
    renewed_s: float = 0.0
    ended: Claim | None = None
    paused_until_s: float = 0.0
    simulated_s: float | None = None
    live: LiveState | None = None
    """What it showed last of the trial that it runs."""
    trials_done: int = 0
    instances_s: dict[str, float] = field(default_factory=dict)
    """When each process of this name was last heard, as far as that is not longer ago than ``SILENT_AFTER_S``."""
    doubled: bool = False
    """A process was heard again after another had taken its place."""
    unkept: str | None = None
    """A new process, as long as the database has not been told of it."""
    arriving: str | None = None
    """A new process, as long as what the last one held has not been ended: a lease given now would be taken for that."""

    def state(self, now_s: float) -> RobotState:
        """What the robot is doing, from all that is known."""
        if self.heartbeat is None or self.lost_s is not None or now_s - self.seen_s > SILENT_AFTER_S:
            return RobotState.LOST
        said = self.heartbeat.state
        if said == RobotState.OUT_OF_SERVICE or self.withdrawn is not None or self.is_doubled(now_s):
            return RobotState.OUT_OF_SERVICE
        if self.drain or said == RobotState.DRAINING:
            return RobotState.DRAINING
        if self.lease is not None:
            return RobotState.RUNNING if self.lease_accepted else RobotState.LEASED
        if said in {RobotState.LEASED, RobotState.RUNNING} and self.said_claim() == self.ended:
            return RobotState.IDLE
        return said

    @property
    def has_left(self) -> bool:
        """Whether the robot said that it goes, had nothing in hand, and went: nobody lost it."""
        return self.says_that_it_goes and self.lost_s is not None and self.lease is None

    @property
    def says_that_it_goes(self) -> bool:
        """Whether it said that it was asked to end, and takes nothing new."""
        return self.heartbeat is not None and self.heartbeat.leaving

    def is_doubled(self, now_s: float) -> bool:
        """Whether two living processes call themselves by this name; nobody can tell which of them has the lease."""
        return self.doubled and sum(now_s - at_s <= SILENT_AFTER_S for at_s in self.instances_s.values()) > 1

    def reason(self, now_s: float) -> str | None:
        """Why the robot is in its state, when it or what is heard of it says so."""
        if self.is_doubled(now_s):
            return f"two processes call themselves {self.robot}; start one of them with --first"
        return self.withdrawn or (None if self.heartbeat is None else self.heartbeat.reason)

    def hear_instance(self, instance: str, now_s: float) -> None:
        """Notes which process spoke; one that is heard again after another means that both live."""
        self.doubled = self.is_doubled(now_s)
        self.instances_s = {each: at_s for each, at_s in self.instances_s.items() if now_s - at_s <= SILENT_AFTER_S}
        if self.heartbeat is not None and instance != self.heartbeat.instance and instance in self.instances_s:
            self.doubled = True
        self.instances_s[instance] = now_s

    def said_claim(self) -> Claim | None:
        """The attempt that the last heartbeat named."""
        beat = self.heartbeat
        return Claim(beat.trial_id, beat.fence, self.robot) if beat and beat.trial_id and beat.fence else None

    def was_cut_off(self, claim: Claim, now_s: float) -> bool:
        """Whether the robot says that the API did not answer it during this attempt; one that is lost says nothing."""
        said = self.heartbeat
        if said is None or self.state(now_s) == RobotState.LOST or self.is_doubled(now_s):
            return False
        return (said.cut_off_trial_id, said.cut_off_fence) == (claim.trial_id, claim.fence)

    def knows_nothing_of(self, claim: Claim, since_s: float, now_s: float) -> bool:
        """Whether the robot lives, has spoken since then, and did not name this attempt."""
        if self.state(now_s) == RobotState.LOST or self.is_doubled(now_s) or self.seen_s <= since_s:
            return False
        return self.said_claim() != claim

    def is_gone(self, now_s: float) -> bool:
        """Whether it may never serve again: lost, or out of service though neither is the API away for it nor its disk full."""
        state, said = self.state(now_s), self.heartbeat
        waits_itself = said is not None and (said.api_away or said.disk_full)
        waits = waits_itself and self.withdrawn is None and not self.is_doubled(now_s)
        return state == RobotState.LOST or (state == RobotState.OUT_OF_SERVICE and not waits)

    def healthy(self, now_s: float) -> bool:
        """In service, be it idle or busy."""
        return self.state(now_s) in IN_SERVICE

    def waits(self, now_s: float) -> bool:
        """Whether it is offered none, be it idle: it has one, has just come, or has just refused one."""
        return self.lease is not None or self.arriving is not None or now_s < self.paused_until_s


@dataclass(frozen=True)
class Seen:
    """All robots at one moment, for who asks about one after the other: each of a thousand is looked at once."""

    fleet: "Fleet"
    now_s: float
    known: tuple[str, ...]
    """Who takes part in a draw, sorted."""
    healthy: frozenset[str]
    """Who is in service."""
    ready: tuple[str, ...]
    """Who may be offered a lease, sorted."""

    @property
    def busy(self) -> frozenset[str]:
        """Who is in service and not idle."""
        return self.healthy - frozenset(self.ready)


@dataclass
class Fleet:
    """All robots by name; owned by the event loop, told by the bus, the dispatcher and the lease routes."""

    members: dict[str, Member] = field(default_factory=dict)
    held_back: str | None = None
    """Why nobody is given a lease though robots are in service, as the end of a sentence."""
    wishes: int = 0
    """How often an operator has wished anything of a robot: what was read before may be older."""

    def member(self, robot: str) -> Member:
        """The robot, known or new."""
        return self.members.setdefault(robot, Member(robot))

    def seen(self, now_s: float) -> Seen:
        """The robots as they are now."""
        known, healthy, ready = [], [], []
        for member in self.members.values():
            if _takes_part(member, now_s):
                known.append(member.robot)
            if (state := member.state(now_s)) in IN_SERVICE:
                healthy.append(member.robot)
            if state == RobotState.IDLE and not member.waits(now_s):
                ready.append(member.robot)
        return Seen(self, now_s, tuple(sorted(known)), frozenset(healthy), tuple(sorted(ready)))

    def healthy(self, now_s: float) -> frozenset[str]:
        """The robots in service."""
        return frozenset(m.robot for m in self.members.values() if m.healthy(now_s))

    def hear_nobody(self) -> None:
        """From here on robots are not heard: what was heard of them says nothing of when they are heard again."""
        for member in self.members.values():
            member.heartbeat, member.present, member.lost_s, member.instances_s = None, False, None, {}

    def serves(self, now_s: float) -> bool:
        """Whether any robot is in service."""
        return any(m.healthy(now_s) for m in self.members.values())

    def is_blind(self, now_s: float) -> bool:
        """Whether robots are in service, and none of them has cameras for policies that see."""
        said = [m.heartbeat for m in self.members.values() if m.healthy(now_s) and m.heartbeat is not None]
        return bool(said) and not any(beat.sees for beat in said)

    def came_anew(self, beat: Heartbeat, now_s: float) -> bool:
        """Whether a heartbeat that was not yet taken comes from another process than the last one.

        Of two that are known to live side by side none is new each time that it speaks.
        """
        member = self.member(beat.robot)
        if member.heartbeat is None or member.heartbeat.instance == beat.instance:
            return member.heartbeat is None
        return not (member.is_doubled(now_s) and beat.instance in member.instances_s)

    def heard(self, beat: Heartbeat, now_s: float) -> bool:
        """Takes a heartbeat; true when it says anything new."""
        member = self.member(beat.robot)
        before, state_before = member.heartbeat, member.state(now_s)
        member.hear_instance(beat.instance, now_s)
        member.heartbeat, member.seen_s = beat, now_s
        if before is not None and before.instance != beat.instance:
            member.simulated_s = member.live = None
        if member.present or (member.lost_s is not None and now_s - member.lost_s > RETURN_AFTER_S):
            member.lost_s = None
        return before is None or _SAID(before) != _SAID(beat) or state_before != member.state(now_s)

    def token_changed(self, robot: str, *, present: bool, now_s: float) -> None:
        """Takes the coming or going of a robot's liveliness token.

        A token that comes back does not say whose it is: only the next heartbeat tells whether the process is the one that went.
        """
        member = self.member(robot)
        member.present = present
        if not present:
            member.lost_s = member.lost_s or now_s

    def leased(self, claim: Claim, now_s: float, *, accepted: bool = False) -> None:
        """The database has given the robot a lease."""
        member = self.member(claim.robot)
        member.lease, member.lease_accepted, member.renewed_s = claim, accepted, now_s
        member.simulated_s = member.live = None

    def accepted(self, claim: Claim) -> None:
        """The robot took the lease."""
        if (member := self.member(claim.robot)).lease == claim:
            member.lease_accepted = True

    def renewed(self, claim: Claim, now_s: float) -> None:
        """The robot renewed its lease."""
        if (member := self.member(claim.robot)).lease == claim:
            member.renewed_s = now_s

    def freed(self, claim: Claim, *, done: bool) -> None:
        """The attempt is over; the robot is free at once, whatever its last heartbeat said."""
        member = self.member(claim.robot)
        member.ended = claim
        member.trials_done += int(done)
        if member.lease == claim:
            member.lease, member.lease_accepted, member.simulated_s, member.live = None, False, None, None

    def hold_only(self, active: Collection[Claim]) -> None:
        """Frees robots whose lease the database no longer knows: it is the truth, this is a copy."""
        for member in self.members.values():
            if member.lease is not None and member.lease not in active:
                self.freed(member.lease, done=False)

    def learn(self, claim: Claim, renewed_s: float, *, accepted: bool) -> None:
        """Takes a lease from the database that another process may have written, or had renewed."""
        member = self.member(claim.robot)
        if member.lease is None and member.ended != claim:
            self.leased(claim, renewed_s, accepted=accepted)
        if member.lease == claim:
            member.lease_accepted = member.lease_accepted or accepted
            member.renewed_s = max(member.renewed_s, renewed_s)

    def left_for_good(self, now_s: float) -> list[str]:
        """Robots that said that they go and did not come back, of whom nothing is to be remembered."""
        gone = [each for each in self.members.values() if each.has_left and each.withdrawn is None and not each.drain]
        return [each.robot for each in gone if now_s - (each.lost_s or 0.0) >= KNOWN_AFTER_LOSS_S]

    def went_back(self, now_s: float) -> None:
        """The clock went back: what was noted at later times counts as if it were of now."""
        for member in self.members.values():
            member.seen_s, member.renewed_s = min(member.seen_s, now_s), min(member.renewed_s, now_s)
            member.paused_until_s = min(member.paused_until_s, now_s)
            member.lost_s = None if member.lost_s is None else min(member.lost_s, now_s)
            member.instances_s = {each: min(at_s, now_s) for each, at_s in member.instances_s.items()}

    def keep_only(self, robots: Collection[str]) -> None:
        """Forgets members that the database knows no more, unless they are there or their rows are still to be written."""
        gone = [m for m in self.members.values() if not (m.present or m.lease or m.unkept or m.robot in robots)]
        for member in gone:
            del self.members[member.robot]

    def snapshot(self, robot: str) -> Member | None:
        """A copy of what is known of the robot; None when it was never seen."""
        member = self.members.get(robot)
        return None if member is None else replace(member)


def _takes_part(member: Member, now_s: float) -> bool:
    if member.heartbeat is None:
        return False
    return member.lost_s is None or now_s - member.lost_s < KNOWN_AFTER_LOSS_S
