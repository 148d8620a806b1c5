"""A robot whose driver moves nothing: bus, leases and HTTP are those of a real robot, a trial takes some hundredths of a second.

How a trial ends depends on its seed alone, so that whatever the platform suffers must not change a success rate.
"""

import contextlib
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import httpx

from api_schemas.robot import Lease, RenewalReply
from api_schemas.trial import FAULT_OF, Measures, Outcome, OutcomeKind, PolicyTiming
from chaos.history import History, Writes
from chaos.orders import Orders
from robot_farm.link.api_link import ApiLink, ApiUnreachableError, LeaseRefusedError, own_token
from robot_farm.link.bus_access import Access
from robot_farm.link.bus_link import Accepted, BusLink
from robot_farm.link.lease_keeper import LeaseKeeper
from robot_farm.link.outage import Standing
from robot_farm.reserve import Reserve
from trial_logs.disk import is_full

CONTROL_PERIOD_S = 0.02
JOIN_AGAIN_S = 0.3
JUDGED = frozenset({OutcomeKind.SUCCEEDED, OutcomeKind.FAILED})
RESERVE_BYTES = 1 << 18
LATE_LEASES = 2.0
"""A robot that was ordered to be late brings its outcome after so many times its lease."""


def expected_success(seed: int) -> bool:
    """Whether a trial with this seed reaches its goal."""
    return seed % 4 != 0


@dataclass(frozen=True)
class RobotSettings:
    """What a robot of this kind is told."""

    name: str
    api: str
    bus: str
    farm: str
    token: str
    evidence: Path
    folder: Path
    trial_s: float
    log_bytes: int


class WatchedLink(ApiLink):
    """The robots' own connection, with a history of the answers that count."""

    def __init__(self, api: str, token: str, history: Writes) -> None:
        super().__init__(api, token)
        self._history = history
        self._client.event_hooks["response"] = [self._note_refusal]

    def renew(self, trial_id: str, robot: str, fence: int) -> RenewalReply:
        """Asks for more time, and notes when it was asked for what was granted."""
        asked_s = time.monotonic()
        reply = super().renew(trial_id, robot, fence)
        self._history("renewed", trial=trial_id, fence=fence, asked_s=asked_s)
        return reply

    def bring(self, lease: Lease, outcome: Outcome, log_sha256: str | None) -> None:
        """Reports an outcome, and notes that it was taken.

        Raises:
            LeaseRefusedError: the lease is no longer ours.
            ApiUnreachableError: no answer in time.
        """
        about = {"trial": lease.trial_id, "fence": lease.fence, "counts": outcome.kind in JUDGED}
        self._history("brought", **about)
        self.report_outcome(lease, outcome, log_sha256)
        self._history("answered", status=200, asked="brought an outcome", **about)

    def _note_refusal(self, response: httpx.Response) -> None:
        if response.is_error:
            parts = response.request.url.path.split("/")  # /v1/leases/TRIAL/…
            trial = parts[3] if parts[2] == "leases" else None
            asked = f"sent {response.request.method} {response.request.url.path}"
            self._history("refused", status=response.status_code, problem=problem_of(response), asked=asked, of_trial=trial)


def problem_of(response: httpx.Response) -> str | None:
    """The last part of the type of an answer that is a problem document; None of any other."""
    if not response.headers.get("content-type", "").startswith("application/problem+json"):
        return None
    response.read()
    return str(response.json().get("type", "")).rpartition("/")[2] or None


def live(settings: RobotSettings, stop: threading.Event) -> None:
    """Takes leases until told to stop."""
    history = History(settings.evidence, settings.name)
    history("started")
    token = None
    while token is None and not stop.is_set():
        try:
            token = own_token(settings.api, settings.token, settings.name)
        except ApiUnreachableError:
            stop.wait(JOIN_AGAIN_S)
    if token is None:
        return
    with contextlib.ExitStack() as stack:
        api = WatchedLink(settings.api, token, history)
        stack.enter_context(api)
        keepers: dict[tuple[str, int], LeaseKeeper] = {}

        def cancel(trial_id: str, fence: int) -> None:
            if (keeper := keepers.get((trial_id, fence))) is not None:
                keeper.cancel()

        access = Access((settings.bus,), settings.farm)
        settings.folder.mkdir(parents=True, exist_ok=True)
        reserve = Reserve(settings.folder, RESERVE_BYTES, lambda text: history("reserve", text=text))
        reserve.take()

        def standing() -> Standing:
            lacks = reserve.lacks
            return Standing() if lacks is None else Standing(lacks, takes_offers=False, disk_full=True)

        link = BusLink(
            access, settings.name, "nominal", live=lambda: None, on_cancel=cancel, stopping=stop.is_set, standing=standing
        )
        bus = stack.enter_context(link)
        orders = Orders(settings.evidence)
        while not stop.is_set():
            if (accepted := bus.next_lease(0.5)) is not None:
                _serve(accepted, settings, api, bus, history, orders, keepers, reserve)
            reserve.take()


def _serve(
    accepted: Accepted,
    settings: RobotSettings,
    api: WatchedLink,
    bus: BusLink,
    history: Writes,
    orders: Orders,
    keepers: dict[tuple[str, int], LeaseKeeper],
    reserve: Reserve,
) -> None:
    """One lease, from acceptance to outcome."""
    lease = accepted.lease
    about = {"trial": lease.trial_id, "fence": lease.fence}
    late_s = time.monotonic() - accepted.at_s
    history("accepted", lease_s=lease.lease_s - late_s, **about)
    log = settings.folder / "trial.log"
    try:
        with contextlib.ExitStack() as held:
            keeper = held.enter_context(LeaseKeeper(api, lease, accepted.at_s))
            keepers[lease.trial_id, lease.fence] = keeper
            bus.running()
            because = _act(lease, settings.trial_s, keeper, history)
            if because is not None:
                history("stopped", because=because, **about)
                if keeper.cancelled:
                    api.bring(lease, _outcome(OutcomeKind.CANCELLED), None)
                return
            reserve.shrink_to(0)
            log.write_bytes(lease.seed.to_bytes(8) + lease.trial_id.encode() + bytes(settings.log_bytes))
            digest = api.upload_log(lease, log)
            log.unlink()
            reserve.take()
            if orders.take("late", settings.name):
                history("late", **about)
                held.close()  # nobody renews the lease any more
                time.sleep(LATE_LEASES * lease.lease_s)
            bus.finishing()
            outcome = _outcome(OutcomeKind.SUCCEEDED if expected_success(lease.seed) else OutcomeKind.FAILED)
            for _ in range(3 if orders.take("thrice", settings.name) else 1):
                api.bring(lease, outcome, digest)
    except (LeaseRefusedError, ApiUnreachableError, RuntimeError) as error:
        history("gave-up", because=str(error)[:300], **about)
    except OSError as error:
        if not is_full(error):
            raise
        history("gave-up", because=str(error), **about)
        _give_back(api, lease)
    finally:
        keepers.clear()
        bus.free(lease)


def _give_back(api: WatchedLink, lease: Lease) -> None:
    """The robot's disk is full: nobody is to be blamed for that."""
    with contextlib.suppress(LeaseRefusedError, ApiUnreachableError, RuntimeError):
        api.bring(lease, _outcome(OutcomeKind.OUT_OF_SPACE), None)


def _act(lease: Lease, trial_s: float, keeper: LeaseKeeper, history: Writes) -> str | None:
    """Acts once in every control period, as a trial does; gives why it was stopped, or None when it came to its end."""
    for _ in range(max(1, round(trial_s / CONTROL_PERIOD_S))):
        if (because := keeper.stop_reason()) is not None:
            return because
        history("acted", trial=lease.trial_id, fence=lease.fence)
        time.sleep(CONTROL_PERIOD_S)
    return None


def _outcome(kind: OutcomeKind) -> Outcome:
    if kind not in JUDGED:
        return Outcome(kind=kind, fault=FAULT_OF[kind], reason="told to stop")
    is_success = kind == OutcomeKind.SUCCEEDED
    measures = Measures(
        success_at_end=is_success,
        success_ever=is_success,
        success_fraction=float(is_success),
        final_position_error_m=0.01,
        final_angle_error_rad=None,
        episode_return=0.0,
        control_steps=1,
        simulated_s=CONTROL_PERIOD_S,
    )
    timing = PolicyTiming(mean_ms=0.1, p99_ms=0.1, max_ms=0.1, allowed_ms=11.0, missed=0)
    return Outcome(kind=kind, fault=FAULT_OF[kind], reason="as its seed says", measures=measures, policy_timing=timing)
