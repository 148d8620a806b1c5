"""Keeps a lease alive while its trial runs, and says when the robot must stop."""

import threading
import time
from types import TracebackType

from api_schemas.robot import RENEW_EVERY_S, Lease, RenewalReply
from robot_farm.link.api_link import ApiFailedError, ApiLink, ApiUnreachableError, LeaseRefusedError, TokenEndedError

CANCELLED = "the job was cancelled"
JOIN_WITHIN_S = 0.5
SILENT_FOR_S = 180.0
"""An attempt that has not asked for so long whether it must stop hangs: the longest that one may be silent is the start of a
policy's process, which has limits of its own (130 s); files that are sent or fetched ask with each part."""
STOPS_WITHIN_S = 120.0
"""A cancelled attempt has so long to stop and to bring its outcome."""


class TrialStoppedError(Exception):
    """The trial was stopped from outside: the lease ended or the job was cancelled."""


class LeaseKeeper:
    """Renews one lease from a thread of its own; a context manager. Owner of the lease's end on the robot's clock.

    Renewals count from before they were asked for, on a monotonic clock, so that the robot stops before the dispatcher gives
    the trial to another. The first period counts from the moment the offer was accepted, at most the offer's way over the
    bus after it was written; the fence refuses whatever a robot does in that moment.

    An attempt that hangs, or does not stop when it is cancelled, is not renewed any more: its trial goes to another robot.
    """

    def __init__(self, api: ApiLink, lease: Lease, taken_at_s: float) -> None:
        self._api, self._lease = api, lease
        self._ends_at_s = taken_at_s + lease.lease_s
        self._stop_reason: str | None = None
        self._asked_at_s = time.monotonic()
        self._cancelled_at_s: float | None = None
        self._unanswered: str | None = None
        self._asking_since_s: float | None = None
        self.hangs: str | None = None
        """Why the lease is left to end though the API would renew it."""
        self.token_ended: TokenEndedError | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._renew, name="lease-keeper", daemon=True)

    def __enter__(self) -> "LeaseKeeper":
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._done.set()
        self._thread.join(timeout=JOIN_WITHIN_S)  # a renewal under way must not keep the next lease waiting

    def cancel(self) -> None:
        """The dispatcher wants the trial stopped."""
        if self._cancelled_at_s is None:  # it is told again until it is heard
            self._cancelled_at_s = time.monotonic()
        self._stop_reason = CANCELLED

    def stop_reason(self) -> str | None:
        """Why the trial must stop now, or None; asked in every control period, and so the sign that the attempt goes on."""
        self._asked_at_s = time.monotonic()
        if self._stop_reason is None and time.monotonic() >= self._ends_at_s:
            self._stop_reason = f"the lease ran out: the API was away for {self._lease.lease_s:g} s"
        return self._stop_reason

    def holds(self) -> bool:
        """Whether the lease lives and nobody has cancelled the trial; asked with each part of a file: a sign of life, too."""
        self._asked_at_s = time.monotonic()
        return self._asked_at_s < self._ends_at_s and self._cancelled_at_s is None

    @property
    def claim(self) -> tuple[str, int]:
        """Trial and fence of the lease."""
        return self._lease.trial_id, self._lease.fence

    @property
    def ran_out(self) -> bool:
        """Whether the lease has ended on the robot's clock."""
        return time.monotonic() >= self._ends_at_s

    @property
    def unanswered(self) -> str | None:
        """Why the API has not answered the last renewal; None when it has, whatever it said."""
        since_s = self._asking_since_s
        asking_s = 0.0 if since_s is None else time.monotonic() - since_s
        return f"no answer to a renewal for {asking_s:.0f} s" if asking_s > self._lease.lease_s / 3 else self._unanswered

    @property
    def cancelled(self) -> bool:
        """Whether the reason to stop is a wish of the user."""
        return self._stop_reason == CANCELLED

    def _renew(self) -> None:
        while not self._done.wait(min(RENEW_EVERY_S, self._lease.lease_s / 3)):
            asked_at_s = time.monotonic()
            if (hangs := self._how_it_hangs(asked_at_s)) is not None:
                self.hangs, self._stop_reason = hangs, self._stop_reason or hangs
                return
            try:
                reply = self._ask()
            except ApiUnreachableError:
                continue  # the lease ends by itself if this goes on
            except LeaseRefusedError as error:
                self._stop_reason = f"the lease is no longer ours: {error}"
                return
            except TokenEndedError as error:
                self._stop_reason, self.token_ended = f"the robot's token has ended: {error}", error
                return
            except Exception as error:  # an answer that nobody understands is no renewal
                self._stop_reason = f"the lease could not be renewed: {type(error).__name__}: {error}"
                return
            self._ends_at_s = asked_at_s + reply.lease_s
            if reply.cancel:
                self.cancel()

    def _ask(self) -> RenewalReply:
        self._asking_since_s, unanswered = time.monotonic(), None
        try:
            return self._api.renew(self._lease.trial_id, self._lease.robot, self._lease.fence)
        except ApiUnreachableError as error:
            unanswered = None if isinstance(error, ApiFailedError) else str(error)
            raise
        finally:
            self._unanswered, self._asking_since_s = unanswered, None

    def _how_it_hangs(self, now_s: float) -> str | None:
        if self._cancelled_at_s is not None and now_s - self._cancelled_at_s > STOPS_WITHIN_S:
            return f"the attempt did not end within {STOPS_WITHIN_S:g} s of its cancellation"
        if now_s - self._asked_at_s > SILENT_FOR_S:
            return f"the attempt has hung for {SILENT_FOR_S:g} s: nothing asked whether it must stop"
        return None
