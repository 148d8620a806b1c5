"""Leases that must end without an outcome: their time is over, their robot is gone, or it did not take them."""

from dataclasses import dataclass

import structlog

from api_schemas.trial import TrialState
from services.database.database import Database
from services.database.rows import AnyRow
from services.jobs import completion
from services.jobs.claim import Claim
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals
from services.settings import Settings

log = structlog.get_logger()


@dataclass
class LeaseEnder:
    """Ends leases that have no outcome."""

    settings: Settings
    database: Database
    clock: FarmClock
    fleet: Fleet
    signals: Signals

    def why_overdue(self, row: AnyRow, now_s: float) -> str | None:
        """Why the lease of an active trial has to end now; None when it may go on."""
        if now_s >= row.lease_until_s:
            return f"the lease of {row.robot} was not renewed in time"
        member = self.fleet.member(row.robot)
        if member.is_doubled(now_s):
            return member.reason(now_s)  # both may be running the trial, under the same fence
        grace_s = self.settings.renew_every_s + 1
        if member.lost_s is not None and now_s - max(member.lost_s, member.renewed_s) >= grace_s:
            return f"{row.robot} was lost and did not come back within {grace_s:g} s"
        return None

    def was_never_offered(self, row: AnyRow, now_s: float) -> bool:
        """Whether an active trial was not accepted by a robot that lives, and that has named another one or none since then.

        The services were ended, or the database went away, between the lease and its offer. A robot that accepts names the trial
        with its next heartbeat.
        """
        given_s, claim = row.lease_until_s - self.settings.lease_s, Claim(row.trial_id, row.fence, row.robot)
        return row.trial_state == TrialState.LEASED and self.fleet.member(row.robot).knows_nothing_of(claim, given_s, now_s)

    async def end(self, claim: Claim, reason: str, *, never_offered: bool = False) -> None:
        """Sends the trial back to the queue, if the claim still holds.

        Where the robot lives and says that the API did not answer it, or was never asked, neither robot nor trial has done
        anything wrong.
        """
        cut_off = self.fleet.member(claim.robot).was_cut_off(claim, self.clock.now_s())
        if cut_off or never_offered:
            reason += ", since the API did not answer it" if cut_off else ", since the services went away before they offered it"
        async with self.database.write() as tx:
            limit = self.settings.max_attempts
            ending = await completion.fault(tx, self.clock.now_s(), claim, reason, limit, excused=cut_off or never_offered)
        self.fleet.freed(claim, done=False)
        if ending is not None and ending.job_id is not None:
            log.warning("platform error of an attempt", trial=claim.trial_id, robot=claim.robot, reason=reason)
            self.signals.job_changed(ending.job_id)
        self.signals.wake_dispatcher()

    async def decline(self, claim: Claim, reason: str) -> None:
        """Sends the trial of a refused offer back to the queue; nothing counts."""
        async with self.database.write() as tx:
            ending = await completion.decline(tx, self.clock.now_s(), claim, reason)
        self.fleet.freed(claim, done=False)
        if ending is not None and ending.job_id is not None:
            log.info("offer refused", trial=claim.trial_id, robot=claim.robot, reason=reason)
            self.signals.job_changed(ending.job_id)
        self.signals.wake_dispatcher()
