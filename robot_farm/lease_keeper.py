"""Keeps a lease alive while its trial runs, and says when the robot must stop."""

import threading
import time
from types import TracebackType

from api_schemas.robot import RENEW_EVERY_S, Lease
from robot_farm.api_link import ApiLink, ApiUnreachableError, LeaseRefusedError, TokenEndedError

CANCELLED = "the job was cancelled"
JOIN_WITHIN_S = 0.5


class TrialStoppedError(Exception):
    """The trial was stopped from outside: the lease ended or the job was cancelled."""


class LeaseKeeper:
    """Renews one lease from a thread of its own; a context manager. Owner of the lease's end on the robot's clock.

    Renewals count from before they were asked for, on a monotonic clock, so that the robot stops before the dispatcher gives
    the trial to another. The first period counts from the moment the offer was accepted, at most the offer's way over the
    bus after it was written; the fence refuses whatever a robot does in that moment.
    """

    def __init__(self, api: ApiLink, lease: Lease, taken_at_s: float) -> None:
        self._api, self._lease = api, lease
        self._ends_at_s = taken_at_s + lease.lease_s
        self._stop_reason: str | None = None
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
        self._stop_reason = CANCELLED

    def stop_reason(self) -> str | None:
        """Why the trial must stop now, or None; asked in every control period."""
        if self._stop_reason is None and time.monotonic() >= self._ends_at_s:
            self._stop_reason = f"the lease ran out: the API was away for {self._lease.lease_s:g} s"
        return self._stop_reason

    @property
    def cancelled(self) -> bool:
        """Whether the reason to stop is a wish of the user."""
        return self._stop_reason == CANCELLED

    def _renew(self) -> None:
        while not self._done.wait(min(RENEW_EVERY_S, self._lease.lease_s / 3)):
            asked_at_s = time.monotonic()
            try:
                reply = self._api.renew(self._lease.trial_id, self._lease.robot, self._lease.fence)
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
