"""Gives leases: looks whenever something changed, writes the lease, commits, and only then offers it over the bus."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from math import inf

import structlog
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.excitation import ExcitationName
from api_schemas.goal import OwnGoal
from api_schemas.job import TaskName
from api_schemas.physics import ObjectName
from api_schemas.policy import PolicyManifest
from api_schemas.robot import Lease
from api_schemas.trial import TrialState
from services.database.database import AWAY, Database
from services.database.postgres import dispatch_alone
from services.database.rows import AnyRow
from services.disk import Disk
from services.dispatcher import queue
from services.dispatcher.abandoned import Abandoner
from services.dispatcher.bus import Bus
from services.dispatcher.canaries import Canaries
from services.dispatcher.commands import Commands
from services.dispatcher.confirming import Confirming
from services.dispatcher.finding import why_unfit
from services.dispatcher.giving import Giver
from services.dispatcher.hearing import NAMED, Hearing
from services.dispatcher.judge import Judge
from services.dispatcher.leading import ASKS_EVERY_S, OF_NO_USE_S, Leadership
from services.dispatcher.overdue import LeaseEnder
from services.dispatcher.steps import Steps
from services.jobs import lease, robots
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet, Seen
from services.jobs.signals import Signals
from services.settings import Settings

log = structlog.get_logger()
MANIFESTS_KEPT = 1000
REST_AT_MOST_S = 0.1
SETTLE_S = 2.0
"""A dispatcher beside others that begins to lead, or to see robots, gives no lease for so long: two heartbeats of every robot."""
REFRESH_EVERY_S = 2.0
"""How often all that the database keeps of robots is read; what they may not do is read at each look."""


@dataclass(frozen=True)
class Metrics:
    """What the dispatcher counts."""

    leases: Counter
    refusals: Counter
    offer_s: Histogram
    claim_s: Histogram
    leads: Gauge

    @classmethod
    def register(cls, registry: CollectorRegistry, *, dispatches: bool = True) -> "Metrics":
        """New counters in the registry of a process that gives leases, or only shows what others do."""
        return cls(
            leases=Counter("trifarm_leases", "Leases that robots accepted", registry=registry),
            refusals=Counter("trifarm_refused_offers", "Offers refused or not answered", registry=registry),
            offer_s=Histogram("trifarm_offer_seconds", "Time until a robot answered an offer", registry=registry),
            claim_s=Histogram(
                "trifarm_claim_seconds", "Time to find a robot's next trial and write its lease", registry=registry
            ),
            # Who may not lead says nothing of it: where only such processes are asked, nobody can be missed.
            leads=Gauge(
                "trifarm_leads",
                "1 for the one dispatcher of several that gives leases now",
                registry=registry if dispatches else None,
            ),
        )


@dataclass
class Dispatcher:
    """Gives leases; one task on the event loop. Of several on one database one leads, and the others wait until it is gone.

    ``shows`` says whether this process shows robots to anyone: then it hears them though another leads.
    """

    settings: Settings
    database: Database
    bus: Bus
    clock: FarmClock
    fleet: Fleet
    signals: Signals
    metrics: Metrics
    disk: Disk
    shows: bool = True
    _manifests: dict[str, PolicyManifest] = field(default_factory=dict)
    _asking: dict[str, asyncio.Task[tuple[PolicyManifest, str]]] = field(default_factory=dict)
    _gives_from_s: float = -inf
    _passed_s: float = -inf
    _refreshed_s: float = -inf
    _hears: bool = False
    _is_away: bool = False

    def __post_init__(self) -> None:
        self._steps = Steps(self.signals)
        self._ender = LeaseEnder(self.settings, self.database, self.clock, self.fleet, self.signals)
        self._hearing = Hearing(self.database, self.clock, self.fleet, self.signals, self._steps, self._ender)
        gone_s = self.settings.pinned_robot_gone_s
        self._abandoner = Abandoner(self.database, self.clock, self.fleet, self.signals, gone_s)
        self._judge = Judge(self.database, self.clock, self.signals, self._alone)
        self._canaries = Canaries(self.database, self.clock, self.signals)
        self._commands = Commands(self.bus, self.clock, self.fleet, self._steps, self.settings.offer_timeout_s)
        self._leading = Leadership(self.database, self.metrics.leads)
        self._confirming = Confirming(self.database, self.clock, self.signals)
        parts = (self.settings, self.database, self.clock, self.fleet, self.signals)
        self._giver = Giver(*parts, self._alone, self._begin_to_offer, self.metrics.claim_s)

    async def run(self) -> None:
        """Looks until the process stops."""
        if self.shows or not self.database.is_shared:
            self._hear()
        leading = None
        if self.database.is_shared:
            self.bus.share_changes(self.signals)
            if self.settings.dispatches:
                leading = asyncio.create_task(self._stay_leader())
        while not self.signals.closing.is_set():
            look_at_active = await self.signals.dispatcher_woken(self.settings.sweep_every_s)
            if self.settings.alive_file is not None:
                with suppress(OSError):  # whoever looks at it finds it old
                    self.settings.alive_file.touch()
            began_s = time.monotonic()
            try:
                gave = await self._look(look_at_active=look_at_active, leads=self.settings.dispatches and self._leading.leads)
                self._passed_s = began_s
                self._note_back()
                if not gave:  # then what happens meanwhile can be looked at together, and requests have the loop for as long
                    await asyncio.sleep(min(time.monotonic() - began_s, REST_AT_MOST_S))
            except (*AWAY, TimeoutError) as error:
                self._note_away(error)
                await asyncio.sleep(self.settings.sweep_every_s)
            except Exception:
                # The dispatcher must outlive any single failure; the next sweep tries again.
                log.exception("dispatcher failed a pass")
                await asyncio.sleep(self.settings.sweep_every_s)
        if leading is not None:
            await leading
            with suppress(*AWAY, TimeoutError):  # then its time runs out
                await self._leading.let_go()
        await self._steps.close(self.settings.offer_timeout_s)

    def _hear(self) -> None:
        """Begins to hear robots, unless it does."""
        if not self._hears:
            self._hearing.listen(self.bus)
        self._hears = True

    def _hear_no_more(self) -> None:
        """Stands by: what a thousand robots say costs too much for those who do nothing with it."""
        if self._hears and not self.shows:
            self._hears = False
            self.bus.hear_no_more()
            self.fleet.hear_nobody()

    async def _stay_leader(self) -> None:
        """Leads, or takes the lead when it is free; beside the passes, one of which may take longer than that may wait."""
        led = saw = said = away = False
        while not self.signals.closing.is_set():
            led = led and self._leading.leads  # who was stopped for longer than a lead lasts begins anew
            sees = self.fleet.serves(self.clock.now_s())
            works = time.monotonic() - self._passed_s < OF_NO_USE_S and self.fleet.held_back is None
            try:
                await self._leading.look(is_of_use=sees and works)
                away = False
            except (*AWAY, TimeoutError) as error:
                if led and not away:
                    log.warning("the database does not say who gives leases", reason=_said(error.__cause__ or error))
                away = True
            except Exception:  # as above
                log.exception("dispatcher failed to ask who gives leases")
            leads = self._leading.leads and (led or await self._begin_to_lead())
            if not leads:
                self._hear_no_more()
            if leads and not (led and saw):
                self._settle()
            # Where no robot is in service they take turns, and nobody has to know.
            if (says := leads and (said or sees)) != said:
                log.info("this dispatcher gives leases now" if says else "this dispatcher gives no leases, another may")
            led, saw, said = leads, sees, says
            await asyncio.sleep(ASKS_EVERY_S)

    async def _begin_to_lead(self) -> bool:
        """Hears robots, and knows nothing of what was while others led; whether that can be."""
        try:
            self._hear()
        except Exception:
            log.exception("this dispatcher cannot hear robots, and lets another lead")
            with suppress(*AWAY, TimeoutError):
                await self._leading.let_go()
            return False
        self._abandoner.begin_anew()
        self.signals.wake_dispatcher(urgent=True)
        return True

    def _settle(self) -> None:
        """Gives no lease for a moment: until every robot was heard, nobody here knows who is in service."""
        self._gives_from_s = time.monotonic() + SETTLE_S

    def _note_away(self, error: Exception) -> None:
        """One line for each time that the database is away or full, however long."""
        if not self._is_away:
            log.error("no leases are given, the database does not do what it is asked", reason=_said(error.__cause__ or error))
        self._is_away = True

    def _note_back(self) -> None:
        if self._is_away:
            log.info("the database answers again, leases are given")
        self._is_away = False

    async def _look(self, *, look_at_active: bool, leads: bool) -> bool:
        """One pass; gives whether any robot got a lease."""
        if look_at_active and (self._hears or leads):
            await self._look_at_active(leads=leads)
            await self._hearing.keep_unkept()
            self._commands.tell_wishes()
        if not leads:
            self.fleet.held_back = None
        if not leads or time.monotonic() < self._gives_from_s:
            return False
        if look_at_active:
            await self._forget_who_left()
            await self._abandoner.look()
        seen = self.fleet.seen(self.clock.now_s())
        await self._judge.look(seen.healthy, also_failed=look_at_active)  # else one that always fails costs every pass
        await self._point_away_from_unfit(seen, also_unknown=look_at_active)
        shortage = self.disk.shortage()
        self.fleet.held_back = None if shortage is None else f"no trial is given out, since {shortage}"
        if shortage is not None or not seen.ready:
            return False  # what runs is finished first
        gave = await self._anything_queued() and await self._giver.give(seen)
        await self._canaries.look([robot for robot in seen.ready if self.fleet.member(robot).lease is None])
        return gave

    async def _forget_who_left(self) -> None:
        """Robots that went after they said so are on no list: where many come and go, they would hide the lost ones."""
        if left := self.fleet.left_for_good(self.clock.now_s()):
            async with self.database.write() as tx:
                await robots.forget_those_without_a_lease(tx, left)
            self._refreshed_s = -inf
            log.info("robots forgotten that went after they had said so", count=len(left), robots=left[:NAMED])

    async def _look_at_active(self, *, leads: bool) -> None:
        refreshes = time.monotonic() - self._refreshed_s >= REFRESH_EVERY_S
        async with self.database.read() as connection:
            rows = await queue.active(connection)
            await (robots.refresh if refreshes else robots.refresh_wishes)(connection, self.fleet)
        self._refreshed_s = time.monotonic() if refreshes else self._refreshed_s
        now_s = self.clock.now_s()
        active = {Claim(row.trial_id, row.fence, row.robot): row for row in rows}
        self.fleet.hold_only(active)
        accepted = []
        for claim, row in active.items():
            renewed_s = row.lease_until_s - self.settings.lease_s
            self.fleet.learn(claim, renewed_s, accepted=row.trial_state == TrialState.RUNNING)
            if not leads:
                continue
            if (reason := self._ender.why_overdue(row, now_s)) is not None:
                await self._ender.end(claim, reason, never_offered=self._ender.was_never_offered(row, now_s))
                continue
            if row.trial_state == TrialState.LEASED and self.fleet.member(claim.robot).said_claim() == claim:
                accepted.append((claim, row.job_id))  # what it answered to the offer was not noted
            if row.cancel_requested or row.state not in lease.UNENDED:
                self._commands.cancel(claim)
        await asyncio.gather(*(self._confirm(*each) for each in accepted))

    async def _point_away_from_unfit(self, seen: Seen, *, also_unknown: bool) -> None:
        """Trials that were drawn for a robot that went go to the next of their orders; also if nobody here ever heard it."""
        healthy = seen.healthy
        unfit = set(self.fleet.members) - healthy
        if not healthy or not (unfit or also_unknown):
            return
        async with self.database.read() as connection:
            if also_unknown:
                unfit |= await queue.drawn_robots(connection) - healthy
            rows = await queue.drawn_for(connection, unfit)
        if rows:
            async with self._alone() as tx:
                for row in rows:
                    await queue.choose_again(tx, row, healthy, why_unfit(self.fleet, seen.now_s))

    async def _anything_queued(self) -> bool:
        async with self.database.read() as connection:
            return await queue.anything_queued(connection)

    @asynccontextmanager
    async def _alone(self, *, lasting: bool = True) -> AsyncIterator[AsyncConnection]:
        """A transaction that no other dispatcher is in."""
        async with self.database.write(lasting=lasting) as tx:
            await dispatch_alone(tx)
            yield tx

    def _begin_to_offer(self, claim: Claim, row: AnyRow) -> None:
        self._steps.start(self._offer(claim, row))

    async def _offer(self, claim: Claim, row: AnyRow) -> None:
        with self.metrics.offer_s.time():
            reply = await self.bus.offer(await self._lease(claim, row), self.settings.offer_timeout_s)
        if reply is not None and reply.accepted:
            self.metrics.leases.inc()
            await self._confirm(claim, row.job_id)
            return
        self.metrics.refusals.inc()
        self.fleet.member(claim.robot).paused_until_s = self.clock.now_s() + self.settings.refused_pause_s
        if reply is None and self.fleet.member(claim.robot).says_that_it_goes:
            await self._ender.decline(claim, f"{claim.robot} went while it was offered a trial")
        elif reply is None:
            await self._ender.end(claim, f"{claim.robot} did not answer the offer")
        else:
            await self._ender.decline(claim, f"{claim.robot} refused the offer: {reply.reason or 'no reason given'}")

    async def _confirm(self, claim: Claim, job_id: str) -> None:
        self.fleet.accepted(claim)
        await self._confirming.confirm(claim, job_id)

    async def _lease(self, claim: Claim, row: AnyRow) -> Lease:
        manifest, graph_sha256 = (None, None) if row.policy is None else await self._policy(row.policy)
        return Lease(
            trial_id=claim.trial_id,
            job_id=row.job_id,
            ordinal=row.ordinal,
            fence=claim.fence,
            robot=claim.robot,
            policy=row.policy,
            manifest=manifest,
            graph_sha256=graph_sha256,
            excitation=None if row.excitation is None else ExcitationName(row.excitation),
            task=TaskName(row.task),
            seed=row.seed,
            object=ObjectName(row.object),
            object_scale=row.object_scale,
            own_goal=None if row.own_goal is None else OwnGoal.model_validate_json(row.own_goal),
            images=row.images,
            lease_s=self.settings.lease_s,
        )

    async def _policy(self, digest: str) -> tuple[PolicyManifest, str]:
        """Manifest and graph; who asks while somebody does waits for the same answer."""
        if digest not in self._asking:
            asking = self._asking[digest] = asyncio.get_running_loop().create_task(self._ask_for_policy(digest))
            asking.add_done_callback(lambda _: self._asking.pop(digest))
        return await asyncio.shield(self._asking[digest])

    async def _ask_for_policy(self, digest: str) -> tuple[PolicyManifest, str]:
        # The graph is not remembered: one that was gone comes back as whatever the present version makes of the weights.
        async with self.database.read() as connection:
            row = await queue.policy_of(connection, digest)
        if digest not in self._manifests:
            if len(self._manifests) >= MANIFESTS_KEPT:
                del self._manifests[next(iter(self._manifests))]
            self._manifests[digest] = PolicyManifest.model_validate_json(row.manifest)
        return self._manifests[digest], row.graph_sha256


def _said(error: BaseException) -> str:
    """What an error says; its name where it says nothing, as one of time does."""
    return str(error) or type(error).__name__
