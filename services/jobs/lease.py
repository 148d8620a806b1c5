"""Leases: the right of one trial to one robot. Each move is one UPDATE guarded by the state and fence that it leaves."""

from typing import Literal

from sqlalchemy import String, and_, bindparam, exists, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.robot import OutcomeReport, Renewal
from api_schemas.trial import AttemptState, OutcomeKind, TrialState
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial, turn
from services.errors import Conflict, NotFound, Refused
from services.jobs import events, pinning
from services.jobs.claim import Claim
from services.jobs.clock import iso
from services.jobs.locking import lock_job, lock_job_of

ACTIVE = (TrialState.LEASED, TrialState.RUNNING)
JUDGED = frozenset({OutcomeKind.SUCCEEDED, OutcomeKind.FAILED})
RAN_TO_THE_END = JUDGED | {OutcomeKind.RECORDED}
"""Outcomes of trials that nothing cut short; without a log nobody could look into them."""
FileKind = Literal["log", "truth"]
UNENDED = (JobState.QUEUED, JobState.RUNNING)

_held = trial.alias("held")
_IS_FREE = ~exists().where(_held.c.robot == bindparam("to_robot"), _held.c.state.in_(ACTIVE))
_LEASE = (
    update(trial)
    .where(
        trial.c.trial_id == bindparam("of_trial"),
        trial.c.state == TrialState.QUEUED,
        trial.c.fence == bindparam("old_fence"),
        _IS_FREE,
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
_EVER_HELD = select(attempt.c.fence).where(attempt.c.trial_id == bindparam("of_trial"), attempt.c.robot == bindparam("held_by"))
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


async def write_lease(
    tx: AsyncConnection, now_s: float, queued: AnyRow, robot: str, *, departure: str | None, lease_s: float
) -> Claim | None:
    """Gives the queued trial to the robot under the next fence.

    None when the trial is no longer as it was read, or when the robot has got another one from somebody else.
    """
    await lock_job(tx, queued.job_number)
    leased = {"of_trial": queued.trial_id, "old_fence": queued.fence, "to_robot": robot, "until_s": now_s + lease_s}
    if (await tx.execute(_LEASE, leased)).rowcount != 1:
        return None
    claim = Claim(queued.trial_id, queued.fence + 1, robot)
    opened = {
        "trial_id": claim.trial_id,
        "fence": claim.fence,
        "job_number": queued.job_number,
        "robot": robot,
        "state": AttemptState.OPEN,
        "departure": departure,
        "started_at": iso(now_s),
    }
    await tx.execute(_OPEN_ATTEMPT, opened)
    if queued.any_robot:
        await pinning.pin(tx, queued.job_number, robot)
    await _tell_leased(tx, now_s, queued, robot)
    await _end_turn(tx, now_s, queued.owner)
    return claim


async def _end_turn(tx: AsyncConnection, now_s: float, owner: str) -> None:
    """The user was served: now others come first."""
    if (await tx.execute(_END_TURN, {"of_owner": owner, "at_s": now_s})).rowcount == 0:
        await tx.execute(insert(turn).values(owner=owner, served_s=now_s))


async def _tell_leased(tx: AsyncConnection, now_s: float, queued: AnyRow, robot: str) -> None:
    at = iso(now_s)
    if queued.job_state == JobState.QUEUED:
        started = {"set_state": JobState.RUNNING, "set_started_at": at}
        await events.record(tx, at, queued.job_number, "job_running", "job running: first trial leased", **started)
    text = f"trial {queued.ordinal} leased to {robot}"
    more = {"ordinal": queued.ordinal, "robot": robot, "add_trials_active": 1}
    await events.record(tx, at, queued.job_number, "trial_leased", text, **more)


async def confirm_lease(tx: AsyncConnection, now_s: float, claim: Claim) -> bool:
    """The robot accepted the offer: the trial runs. False when the lease ended in the meantime."""
    held = {"of_trial": claim.trial_id, "held_fence": claim.fence}
    await lock_job_of(tx, claim.trial_id)
    row = (await tx.execute(_CONFIRM, held)).one_or_none()
    if row is None:
        return False
    text = f"trial {row.ordinal} running on {claim.robot}"
    await events.record(tx, iso(now_s), row.job_number, "trial_running", text, ordinal=row.ordinal, robot=claim.robot)
    return True


async def shorten(tx: AsyncConnection, until_s: float) -> None:
    """Lets no lease last longer than until then, as those would that were given before the clock went back."""
    longer = update(trial).where(trial.c.state.in_(ACTIVE), trial.c.lease_until_s > until_s)
    await tx.execute(longer.values(lease_until_s=until_s))


async def renew(tx: AsyncConnection, now_s: float, trial_id: str, renewal: Renewal, lease_s: float) -> bool:
    """Prolongs a lease; true when the robot should stop because the job was cancelled.

    Raises:
        NotFound: there is no such trial.
        Conflict: the lease is not the robot's any more.
    """
    prolonged = (
        update(trial)
        .where(
            trial.c.trial_id == trial_id,
            trial.c.fence == renewal.fence,
            trial.c.robot == renewal.robot,
            trial.c.state.in_(ACTIVE),
        )
        .values(lease_until_s=now_s + lease_s)
        .returning(trial.c.job_number)
    )
    number = (await tx.execute(prolonged)).scalar_one_or_none()
    if number is None:
        raise await stale(tx, trial_id, renewal.fence, renewal.robot)
    row = (await tx.execute(select(job.c.cancel_requested, job.c.state).where(job.c.number == number))).one()
    return row.cancel_requested or row.state not in UNENDED


async def check_lease(connection: AsyncConnection, trial_id: str, fence: int, robot: str | None) -> None:
    """Raises unless the trial is leased or running under this fence; with ``robot``, by it."""
    held = _HELD if robot is None else _HELD.where(trial.c.robot == robot)
    if (await connection.execute(held, {"of_trial": trial_id, "held_fence": fence})).one_or_none() is None:
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
