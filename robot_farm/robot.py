"""One robot at work: wait for a lease, get ready, run its trial, bring home log and outcome, again."""

import contextlib
import functools
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import zenoh

from api_schemas.builtin_policies import BUILTIN_NAMES
from api_schemas.bus import LiveState
from api_schemas.jail_report import JailReport
from api_schemas.robot import Lease
from api_schemas.trial import FAULT_OF, MAX_REASON, Fault, Outcome, OutcomeKind
from jail.detection import detect
from jail.level import Jail, too_open
from robot_farm.core import stay_on_one_core, turn
from robot_farm.health import WatchedHealth
from robot_farm.hidden_physics import HiddenPhysics, farm_secret
from robot_farm.ideal_life import IdealLife
from robot_farm.life import Life, OutOfServiceError
from robot_farm.link.admission import asked_until_answered, renewed
from robot_farm.link.api_link import (
    PART_BYTES,
    ApiLink,
    ApiUnreachableError,
    LeaseRefusedError,
    Patience,
    TokenEndedError,
    own_token,
)
from robot_farm.link.bus_access import Access, ask_access
from robot_farm.link.bus_link import Accepted, BusLink
from robot_farm.link.lease_keeper import CANCELLED, LeaseKeeper, TrialStoppedError
from robot_farm.link.outage import Outage, Standing
from robot_farm.policy.jail import BUILTIN_PROCESS, POLICY_PROCESS, JailedPolicy
from robot_farm.process import Ending
from robot_farm.reserve import Reserve
from robot_farm.run import Progress, live_state
from robot_farm.settings import Settings
from robot_farm.sight import Sight, blind, blind_to
from robot_farm.trial import run_trial
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.trifinger.form import scene_form
from trial_logs.disk import is_full

IDLE_WAIT_S = 5.0
"""Between two looks at what happens seldom: certificates that end, an API that is back."""
GOES_AFTER_S = 1.0
"""So long a robot that goes still declines what is on its way to it, so that nobody waits for an answer."""
UNFINISHED = "unfinished"
UNFINISHED_KEPT = 5


@functools.cache
def host_jail() -> Jail:
    """The jail that policies get on this host, which the warm parent tries out once for all of its robots."""
    return detect()


class Robot:
    """One robot. Owner of its life, of the policy process and of the lease in hand."""

    def __init__(self, name: str, settings: Settings, say: Callable[[str], None]) -> None:
        self._name, self._settings, self._say = name, settings, say
        self._folder = settings.robot_folder(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._core = stay_on_one_core(name)
        self._keep_left_overs()
        self._life = _life(name, settings)
        self._channels = self._life.log_channels()
        self._truth_channels = truth_channels()
        self._jail = host_jail()
        self._policy: JailedPolicy | None = None
        self._lease: Lease | None = None
        self._keeper: LeaseKeeper | None = None
        self._outage = Outage(say)
        self._reserve = Reserve(self._folder, settings.reserve_bytes, say)
        self._progress = Progress()
        self._watched = WatchedHealth(lambda: self._progress, self._life)

    def live_until(self, ending: Ending) -> None:
        """Take leases until told to end; a trial that cannot be finished any more is given back as the platform's fault.

        Raises:
            NotAdmittedError: the farm does not take the robot, or no longer.
        """
        leaving = ending.leaving
        with contextlib.ExitStack() as stack:
            self._test(leaving)
            self._reserve.take()
            token = asked_until_answered(self._own_token, leaving, self._say)
            if token is None:
                return
            api = stack.enter_context(ApiLink(self._settings.api, token, ca=self._settings.ca))
            stack.callback(self._end_policy)

            def ask() -> Access:
                return ask_access(api, self._name, self._settings)

            access = asked_until_answered(ask, leaving, self._say)
            if access is None:
                return
            bus = stack.enter_context(
                BusLink(
                    access,
                    self._name,
                    self._settings.physics_name,
                    physics_digest=self._life.physics_digest,
                    form=scene_form(),
                    live=self._live_state,
                    on_cancel=self._cancel,
                    stopping=leaving.is_set,
                    jail=JailReport.of(self._jail),
                    health=self._watched.health,
                    standing=self._standing,
                    alive_file=self._settings.alive_file,
                    sees=blind() is None,
                )
            )
            bus.out_of_service(self._unfit)
            threading.Thread(target=_leave_at, args=(ending, bus), daemon=True).start()
            while not leaving.is_set():
                accepted = bus.next_lease(IDLE_WAIT_S)
                if accepted is not None:
                    self._serve(accepted, api, bus, ending.stop)
                    if leaving.is_set():
                        break
                elif bus.resume_asked():
                    self._test(leaving)
                    bus.out_of_service(self._unfit)
                self._reserve.take()
                self._outage.look(lambda: api.try_out(self._name))
                access = renewed(access, ask, bus, self._say)
            if ending.drain_s > 0.0:
                bus.leave()
                while not ending.stop.is_set() and (accepted := bus.accepted_already()) is not None:
                    self._serve(accepted, api, bus, ending.stop)
                ending.stop.wait(GOES_AFTER_S)

    def _own_token(self) -> str:
        return own_token(self._settings.api, self._settings.token, self._name, ca=self._settings.ca)

    def _serve(self, accepted: Accepted, api: ApiLink, bus: BusLink, stop: threading.Event) -> None:
        """One lease, from acceptance to outcome. Nothing that goes wrong here ends the robot but the end of its token."""
        lease = accepted.lease
        log = self._folder / f"{lease.trial_id}-{lease.fence}.mcap"
        truth = log.with_suffix(".truth.mcap")
        for file in (log, truth):
            file.unlink(missing_ok=True)
        try:
            with LeaseKeeper(api, lease, accepted.at_s) as keeper:
                self._progress = Progress()
                self._lease, self._keeper = lease, keeper
                self._outage.begin(keeper)
                bus.running()
                outcome = self._attempt(lease, api, keeper, log, TruthFile(truth, self._truth_channels), stop)
                bus.out_of_service(self._unfit)
                if keeper.token_ended is not None:
                    raise keeper.token_ended
                if outcome is not None:  # files first, outcome last
                    patience = self._outage.patience(keeper, stop)
                    truth_digest, digest = self._bring_files(lease, api, truth, log, patience)
                    bus.finishing()
                    api.report_outcome(lease, outcome, digest, truth_digest, patience)
                    self._outage.came_home()
        except (LeaseRefusedError, ApiUnreachableError) as error:
            self._say(f"trial {lease.trial_id}, attempt {lease.fence}: outcome not accepted: {error}")
            if isinstance(error, ApiUnreachableError):
                if self._keeper is not None and self._keeper.cancelled:
                    self._report(lease, api, OutcomeKind.CANCELLED, f"{CANCELLED} while its files could not be sent: {error}")
                self._outage.ended(error)
        except TokenEndedError:
            raise
        except Exception as error:
            self._say(f"trial {lease.trial_id}, attempt {lease.fence}: {type(error).__name__}: {error}")
            reason = f"{self._name} could not deliver its outcome: {type(error).__name__}: {error}"
            self._report(lease, api, _kind_of(error), reason)
        finally:
            self._outage.ended()
            self._lease = self._keeper = None
            for file in (log, truth):
                file.unlink(missing_ok=True)
            self._reserve.take()
            bus.free(lease)

    def _bring_files(
        self, lease: Lease, api: ApiLink, truth: Path, log: Path, patience: Patience
    ) -> tuple[str | None, str | None]:
        """Truth and log come home, and the robot takes its reserve anew: from the outcome on the next offer may come."""

        def gives_way(error: ApiUnreachableError | None) -> bool:
            self._reserve.give_way(PART_BYTES)  # of what is sent, services on this disk write as much
            return patience(error)

        digests = (
            api.upload_truth(lease, truth, gives_way) if truth.exists() else None,
            api.upload_log(lease, log, gives_way) if log.exists() else None,
        )
        for file in (log, truth):
            file.unlink(missing_ok=True)
        self._reserve.take()
        return digests

    def _standing(self) -> Standing:
        """How the robot stands with the API and with its disk."""
        standing, lacks = self._outage.standing(), self._reserve.lacks
        if lacks is None or not standing.takes_offers:
            return standing
        return replace(standing, reason=lacks, takes_offers=False, disk_full=True)

    def _attempt(
        self, lease: Lease, api: ApiLink, keeper: LeaseKeeper, log: Path, truth: TruthFile, stop: threading.Event
    ) -> Outcome | None:
        """The outcome to report, or None when the lease is lost and nobody would listen."""

        def stop_reason() -> str | None:
            self._reserve.follow(log, truth.path)
            return "the robot is being stopped" if stop.is_set() else keeper.stop_reason()

        if (lacks := blind_to(lease)) is not None:
            return _ended(OutcomeKind.PLATFORM_ERROR, lacks)
        try:
            policy = self._policy_for(lease, api, self._outage.patience(keeper, stop))
            self._outage.waits = None
            with turn(self._settings.robots_folder, self._core, stop_reason=stop_reason):
                prepared = self._life.prepare(lease, truth, stop_reason)
                outcome = run_trial(
                    lease,
                    policy,
                    self._life.driver,
                    self._channels,
                    log,
                    stop_reason=stop_reason,
                    physics=self._settings.physics_name,
                    progress=self._progress,
                    prepared=prepared,
                )
        except OutOfServiceError as error:
            self._say(f"trial {lease.trial_id}, attempt {lease.fence}: given back: {error}")
            return _ended(OutcomeKind.PLATFORM_ERROR, str(error))
        except TrialStoppedError as error:
            self._end_policy()
            if keeper.cancelled:
                return _ended(OutcomeKind.CANCELLED, str(error))
            return _ended(OutcomeKind.PLATFORM_ERROR, str(error)) if stop.is_set() else None
        except (LeaseRefusedError, ApiUnreachableError, TokenEndedError):
            raise
        except Exception as error:
            self._end_policy()
            self._life.forget()
            self._say(f"trial {lease.trial_id}, attempt {lease.fence}: {type(error).__name__}: {error}")
            return _ended(_kind_of(error), f"{type(error).__name__}: {error}")
        if FAULT_OF[outcome.kind] is not Fault.NONE:
            self._end_policy()  # never trusted with another trial in the same process
        return outcome

    def _test(self, stop: threading.Event) -> None:
        """Have the robot test itself outside any trial."""

        def stop_reason() -> str | None:
            return "the robot is being stopped" if stop.is_set() else None

        found = self._life.test_in_turn(turn(self._settings.robots_folder, self._core, stop_reason=stop_reason), stop_reason)
        if found is not None:
            self._say(f"self-test: {found}")

    @property
    def _unfit(self) -> str | None:
        """Why the robot is out of service, None while it serves."""
        reason = too_open(self._jail, self._settings.jail_level)
        return self._life.wrong if reason is None else reason

    def _report(self, lease: Lease, api: ApiLink, kind: OutcomeKind, reason: str) -> None:
        """Say how the attempt ended without what it made, so that nobody waits until its lease runs out."""
        try:
            api.report_outcome(lease, _ended(kind, reason), None)
            self._outage.came_home()
        except Exception as error:  # then the lease runs out by itself
            self._say(f"trial {lease.trial_id}, attempt {lease.fence}: nor could that be told: {error}")

    def _keep_left_overs(self) -> None:
        """Logs of a process that was killed: their leases are void, but what they hold may explain what happened."""
        kept = self._folder / UNFINISHED
        for log in self._folder.glob("*.mcap"):
            kept.mkdir(exist_ok=True)
            self._say(f"the log of an attempt that was cut off is kept as {log.rename(kept / log.name)}")
        for old in sorted(kept.glob("*.mcap"), key=lambda path: path.stat().st_mtime)[:-UNFINISHED_KEPT]:
            old.unlink()

    def _policy_for(self, lease: Lease, api: ApiLink, patience: Patience) -> JailedPolicy | None:
        """The kept process if it runs this policy, a new one otherwise; none for an excitation."""
        if lease.policy is None or lease.graph_sha256 is None:
            return None
        if self._policy is not None and self._policy.digest == lease.policy:
            return self._policy
        self._end_policy()
        graph = api.fetch_graph(lease.policy, lease.graph_sha256, self._folder, patience)
        module = BUILTIN_PROCESS if lease.policy in BUILTIN_NAMES else POLICY_PROCESS
        images = None if lease.manifest is None else lease.manifest.images
        self._policy = JailedPolicy(lease.policy, graph, least=self._settings.jail_level, module=module, images=images)
        return self._policy

    def _end_policy(self) -> None:
        if self._policy is not None:
            self._policy.close()
            self._policy = None

    def _cancel(self, trial_id: str, fence: int) -> None:
        lease, keeper = self._lease, self._keeper
        if lease is not None and keeper is not None and (lease.trial_id, lease.fence) == (trial_id, fence):
            keeper.cancel()

    def _live_state(self) -> LiveState | None:
        lease = self._lease
        return None if lease is None else live_state(lease, self._progress)


def _life(name: str, settings: Settings) -> Life | IdealLife:
    """What the robot is between its trials; an ideal robot's life is one without effects."""
    if settings.is_plain:
        return IdealLife(Sight(settings.tracker))
    hidden = HiddenPhysics(farm_secret(settings.robots_folder, settings.farm_seed), name, settings.physics)
    return Life(
        robot=name,
        draw=hidden.of_trial,
        reset=settings.reset,
        faults=tuple(fault for fault in settings.faults if fault.robot == name),
        fault_rate=settings.fault_rate,
        self_test_every=settings.self_test_every,
        physics_digest=hidden.digest(),
        sight=Sight(settings.tracker),
    )


def _leave_at(ending: Ending, bus: BusLink) -> None:
    """Has a robot say at once that it goes, and notice it while it waits for a lease; for a thread of its own."""
    ending.leaving.wait()
    if ending.drain_s > 0.0:
        with contextlib.suppress(zenoh.ZError):  # it may be gone already
            bus.leave()
    bus.wake()


def _kind_of(error: Exception) -> OutcomeKind:
    """What an attempt that failed by this error ends with: a full disk is no fault of the robot's."""
    return OutcomeKind.OUT_OF_SPACE if is_full(error) else OutcomeKind.PLATFORM_ERROR


def _ended(kind: OutcomeKind, reason: str) -> Outcome:
    return Outcome(kind=kind, fault=FAULT_OF[kind], reason=reason[:MAX_REASON])
