"""Leases: the right of one trial to one robot. Each move is one UPDATE guarded by the state and fence that it leaves."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from sqlalchemy import String, and_, bindparam, exists, func, insert, select, union_all, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import EventKind, JobState
from api_schemas.robot import OutcomeReport, Renewal
from api_schemas.trial import AttemptState, OutcomeKind, TrialState
from services.database.postgres import is_postgres
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial, turn
from services.database.tables import robot as robot_table
from services.errors import Conflict, NotFound, Refused
from services.jobs import events, pinning
from services.jobs.claim import Claim
from services.jobs.clock import iso
from services.jobs.locking import change_free, lock_job, lock_job_of_all

ACTIVE = (TrialState.LEASED, TrialState.RUNNING)
JUDGED = frozenset({OutcomeKind.SUCCEEDED, OutcomeKind.FAILED})
RAN_TO_THE_END = JUDGED | {OutcomeKind.RECORDED}
"""Outcomes of trials that nothing cut short; without a log nobody could look into them."""
FileKind = Literal["log", "truth"]
UNENDED = (JobState.QUEUED, JobState.RUNNING)

_held = trial.alias("held")
_IS_FREE = ~exists().where(_held.c.robot == bindparam("to_robot"), _held.c.state.in_(ACTIVE))
_IS_DRAINED = exists().where(robot_table.c.robot == bindparam("to_robot"), robot_table.c.drain.is_(True))
_NAMED = bindparam("robots", expanding=True)
_CANNOT = union_all(
    select(_held.c.robot).where(_held.c.robot.in_(_NAMED), _held.c.state.in_(ACTIVE)),
    select(robot_table.c.robot).where(robot_table.c.robot.in_(_NAMED), robot_table.c.drain.is_(True)),
)
_LEASE = (
    update(trial)
    .where(
        trial.c.trial_id == bindparam("of_trial"),
        trial.c.state == TrialState.QUEUED,
        trial.c.fence == bindparam("old_fence"),
        _IS_FREE,
        ~_IS_DRAINED,
    )
    .values(
        state=TrialState.LEASED,
        fence=trial.c.fence + 1,
        robot=bindparam("to_robot"),
        lease_until_s=bindparam("until_s"),
        passed_over_s=None,
    )
)
_CONFIRM = (
    update(trial)
    .where(
        trial.c.trial_id == bindparam("of_trial"),
        trial.c.fence == bindparam("held_fence"),
        trial.c.state == TrialState.LEASED,
    )
    .values(state=TrialState.RUNNING)
    .returning(trial.c.job_number, trial.c.ordinal)
)
_HELD = select(trial.c.trial_id).where(
    trial.c.trial_id == bindparam("of_trial"), trial.c.fence == bindparam("held_fence"), trial.c.state.in_(ACTIVE)
)
IS_HELD = and_(
    trial.c.trial_id == bindparam("of_trial"),
    trial.c.fence == bindparam("held_fence"),
    trial.c.robot == bindparam("held_by"),
    trial.c.state.in_(ACTIVE),
)
"""Whether the robot has the trial under this fence now."""
_HELD_BY = select(trial.c.trial_id).where(IS_HELD)
_EVER_HELD = select(attempt.c.fence).where(attempt.c.trial_id == bindparam("of_trial"), attempt.c.robot == bindparam("held_by"))
_RENEW = update(trial).where(IS_HELD).values(lease_until_s=bindparam("until_s")).returning(trial.c.job_number)
_STATE = select(job.c.cancel_requested, job.c.state).where(job.c.number == bindparam("of_job"))
_RENEWED = _RENEW.cte("renewed")
_RENEW_AND_STATE = select(job.c.cancel_requested, job.c.state).join(_RENEWED, _RENEWED.c.job_number == job.c.number)
_OPEN_ATTEMPT = insert(attempt)
_IS_OPEN = and_(
    attempt.c.trial_id == bindparam("of_trial"),
    attempt.c.fence == bindparam("held_fence"),
    attempt.c.state == AttemptState.OPEN,
)
_KEEP = {
    "log": update(attempt).where(_IS_OPEN).values(log_sha256=bindparam("to_sha256")),
    "truth": update(attempt).where(_IS_OPEN).values(truth_sha256=bindparam("to_sha256")),
}
_KEPT = (
    select(attempt.c.log_sha256, attempt.c.truth_sha256, trial.c.excitation)
    .join(trial, trial.c.trial_id == attempt.c.trial_id)
    .where(_IS_OPEN, attempt.c.robot == bindparam("held_by"))
)
_END_TURN = update(turn).where(turn.c.owner == bindparam("of_owner")).values(served_s=bindparam("at_s"))
_CLOSE_ATTEMPT = (
    update(attempt)
    .where(_IS_OPEN)
    .values(
        state=bindparam("to_state"),
        reason=bindparam("to_reason"),
        ended_at=bindparam("at"),
        outcome=bindparam("to_outcome"),
        log_sha256=func.coalesce(bindparam("to_log_sha256", type_=String), attempt.c.log_sha256),
        truth_sha256=func.coalesce(bindparam("to_truth_sha256", type_=String), attempt.c.truth_sha256),
    )
)


async def who_cannot(tx: AsyncConnection, robots: Sequence[str]) -> frozenset[str]:
    """Those of the robots that have a lease or are drained, as others may have written since they were heard of."""
    return frozenset((await tx.execute(_CANNOT, {"robots": list(robots)})).scalars())


@dataclass
class Leases:
    """Leases that one transaction gives; ``finish`` writes what follows from them, once for each job.

    Whose turn it was is the giver's to write (``end_turn``).
    """

    tx: AsyncConnection
    now_s: float
    lease_s: float
    _written: list[tuple[Claim, AnyRow, str | None]] = field(default_factory=list)

    async def write(self, queued: AnyRow, robot: str, departure: str | None) -> Claim | None:
        """Gives the queued trial to the robot under the next fence.

        None when the trial is no longer as it was read, or when somebody else has given the robot another one or drained it.
        """
        await lock_job(self.tx, queued.job_number)
        until_s = self.now_s + self.lease_s
        leased = {"of_trial": queued.trial_id, "old_fence": queued.fence, "to_robot": robot, "until_s": until_s}
        if (await self.tx.execute(_LEASE, leased)).rowcount != 1:
            return None
        claim = Claim(queued.trial_id, queued.fence + 1, robot)
        if queued.any_robot:
            await pinning.pin(self.tx, queued.job_number, robot)
        self._written.append((claim, queued, departure))
        return claim

    async def finish(self) -> None:
        """Opens the attempts, and tells the jobs' histories of them."""
        at = iso(self.now_s)
        opened = [
            {
                "trial_id": claim.trial_id,
                "fence": claim.fence,
                "job_number": queued.job_number,
                "robot": claim.robot,
                "state": AttemptState.OPEN,
                "departure": departure,
                "started_at": at,
            }
            for claim, queued, departure in self._written
        ]
        if opened:
            await self.tx.execute(_OPEN_ATTEMPT, opened)
        of_jobs: dict[int, list[events.Line]] = {}
        waiting = {queued.job_number for _, queued, _ in self._written if queued.job_state == JobState.QUEUED}
        for claim, queued, _ in self._written:
            text = f"trial {queued.ordinal} leased to {claim.robot}"
            of_jobs.setdefault(queued.job_number, []).append(
                events.Line(EventKind.TRIAL_LEASED, text, queued.ordinal, claim.robot)
            )
        for number, lines in of_jobs.items():
            changes: dict[str, Any] = {"add_trials_active": len(lines)}
            if number in waiting:
                changes |= {"set_state": JobState.RUNNING, "set_started_at": at}
                lines.insert(0, events.Line(EventKind.JOB_RUNNING, "job running: first trial leased"))
            await events.record_all(self.tx, at, number, lines, **changes)
        self._written.clear()


async def end_turn(tx: AsyncConnection, now_s: float, owner: str) -> None:
    """The user was served: now others come first."""
    if (await tx.execute(_END_TURN, {"of_owner": owner, "at_s": now_s})).rowcount == 0:
        await tx.execute(insert(turn).values(owner=owner, served_s=now_s))


async def confirm_leases(tx: AsyncConnection, now_s: float, claims: Collection[Claim]) -> Collection[Claim]:
    """The robots accepted the offers of one job's trials: these run. Gives whose do; of others the lease ended meanwhile."""
    await lock_job_of_all(tx, [claim.trial_id for claim in claims])
    of_jobs: dict[int, list[events.Line]] = {}
    confirmed = []
    for claim in sorted(claims, key=lambda each: each.trial_id):
        row = (await tx.execute(_CONFIRM, {"of_trial": claim.trial_id, "held_fence": claim.fence})).one_or_none()
        if row is not None:
            text = f"trial {row.ordinal} running on {claim.robot}"
            of_jobs.setdefault(row.job_number, []).append(events.Line(EventKind.TRIAL_RUNNING, text, row.ordinal, claim.robot))
            confirmed.append(claim)
    for number, lines in of_jobs.items():
        await events.record_all(tx, iso(now_s), number, lines)
    return confirmed


async def shorten(tx: AsyncConnection, until_s: float) -> bool:
    """Lets no lease last longer than until then, as those would that were given before the clock went back.

    Gives whether that was all of them: those that somebody is changing now are passed over.
    """
    longer = (trial.c.state.in_(ACTIVE), trial.c.lease_until_s > until_s)
    return await change_free(tx, trial.c.trial_id, longer, {"lease_until_s": until_s})


async def renew(connection: AsyncConnection, now_s: float, trial_id: str, renewal: Renewal, lease_s: float) -> bool:
    """Prolongs a lease; true when the robot should stop because the job was cancelled. One statement where the database can.

    Raises:
        NotFound: there is no such trial.
        Conflict: the lease is not the robot's any more.
    """
    held = {"of_trial": trial_id, "held_fence": renewal.fence, "held_by": renewal.robot, "until_s": now_s + lease_s}
    if is_postgres(connection):
        row = (await connection.execute(_RENEW_AND_STATE, held)).one_or_none()
    else:
        number = (await connection.execute(_RENEW, held)).scalar_one_or_none()
        row = None if number is None else (await connection.execute(_STATE, {"of_job": number})).one()
    if row is None:
        raise await stale(connection, trial_id, renewal.fence, renewal.robot)
    return row.cancel_requested or row.state not in UNENDED


async def check_lease(connection: AsyncConnection, trial_id: str, fence: int, robot: str | None) -> None:
    """Raises unless the trial is leased or running under this fence; with ``robot``, by it."""
    named = {"of_trial": trial_id, "held_fence": fence} | ({} if robot is None else {"held_by": robot})
    if (await connection.execute(_HELD if robot is None else _HELD_BY, named)).one_or_none() is None:
        raise await stale(connection, trial_id, fence, robot)


async def check_policy_leased(connection: AsyncConnection, digest: str, robot: str | None) -> None:
    """Raises unless the robot holds a lease of a trial with this policy; without ``robot`` whoever asks may have any.

    Raises:
        NotFound: it holds none, whether there is such a policy or not.
    """
    if robot is None:
        return
    leased = select(trial.c.trial_id).join(job, job.c.number == trial.c.job_number)
    leased = leased.where(trial.c.state.in_(ACTIVE), trial.c.robot == robot, job.c.policy == digest).limit(1)
    if (await connection.execute(leased)).first() is None:
        raise NotFound("policy-not-leased", f"{robot} holds no lease of a trial with the policy {digest}; it needs no graph.")


async def keep_file(tx: AsyncConnection, trial_id: str, fence: int, kind: FileKind, sha256: str) -> None:
    """Notes which file was uploaded under the lease; its outcome can name no other.

    Raises:
        Conflict: the attempt has ended meanwhile.
    """
    kept = {"of_trial": trial_id, "held_fence": fence, "to_sha256": sha256}
    if (await tx.execute(_KEEP[kind], kept)).rowcount != 1:
        raise await stale(tx, trial_id, fence)


async def check_report(connection: AsyncConnection, claim: Claim, report: OutcomeReport) -> None:
    """Raises unless the outcome of an open attempt fits its trial and names the files that were uploaded under its lease.

    Raises:
        Refused: it names others, or no log though it ran to its end, or it is none that such a trial can have.
    """
    open_attempt = {"of_trial": claim.trial_id, "held_fence": claim.fence, "held_by": claim.robot}
    row = (await connection.execute(_KEPT, open_attempt)).one_or_none()
    if row is None:
        return
    kind = report.outcome.kind
    if kind in (JUDGED if row.excitation is not None else {OutcomeKind.RECORDED}):
        ends = "is of an excitation and can only be recorded" if row.excitation is not None else "has a goal to succeed in"
        raise Refused("wrong-outcome", f"Trial {claim.trial_id} {ends}; its outcome cannot be {kind}.")
    _check_file("log", claim, report.log_sha256, row.log_sha256, needed=kind in RAN_TO_THE_END)
    _check_file("truth", claim, report.truth_sha256, row.truth_sha256, needed=False)


def _check_file(kind: FileKind, claim: Claim, named: str | None, kept: str | None, *, needed: bool) -> None:
    if (named is None and not needed) or (named is not None and named == kept):
        return
    was = "none was" if kept is None else f"{kept} was"
    detail = f"The outcome names {'no ' + kind if named is None else f'{kind} {named}'}, but {was} uploaded under this lease; "
    path = f"/v1/leases/{claim.trial_id}/{claim.fence}/{kind}"
    raise Refused(f"{kind}-missing", detail + f"PUT {path} first and name its SHA-256.")


async def stale(connection: AsyncConnection, trial_id: str, fence: int, robot: str | None = None) -> Exception:
    """The error that tells a robot why its lease does not hold; of trials that it never held it learns nothing."""
    held = robot is None or (await connection.execute(_EVER_HELD, {"of_trial": trial_id, "held_by": robot})).first() is not None
    wanted = select(trial.c.fence, trial.c.state).where(trial.c.trial_id == trial_id)
    row = (await connection.execute(wanted)).one_or_none()
    if row is None or not held:
        return NotFound("trial-not-found", f"There is no trial {trial_id} of this robot's.")
    now = f"Trial {trial_id} is {row.state} under fence {row.fence}; fence {fence} does not hold it."
    detail = f"{now} Stop and take a new lease."
    return Conflict("stale-fence", detail, fence=row.fence, state=row.state)


async def close_attempt(
    tx: AsyncConnection,
    now_s: float,
    claim: Claim,
    state: AttemptState,
    reason: str | None,
    *,
    report: OutcomeReport | None = None,
) -> None:
    """Writes the end of an attempt, with the robot's report of it if there is one."""
    closed = {
        "of_trial": claim.trial_id,
        "held_fence": claim.fence,
        "to_state": state,
        "to_reason": reason,
        "at": iso(now_s),
        "to_outcome": None if report is None else report.outcome.model_dump_json(),
        "to_log_sha256": None if report is None else report.log_sha256,
        "to_truth_sha256": None if report is None else report.truth_sha256,
    }
    await tx.execute(_CLOSE_ATTEMPT, closed)
