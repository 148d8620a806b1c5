"""How attempts and jobs end: outcomes are accepted exactly once, platform faults send the trial back to the queue."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Integer, bindparam, func, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import EventKind, JobState, TaskName
from api_schemas.robot import OutcomeReport
from api_schemas.trial import FAULT_OF, AttemptState, Fault, Outcome, OutcomeKind, TrialState
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial, webhook
from services.errors import Refused
from services.jobs import canary, events, outcomes, physics, pinning, reports, robots
from services.jobs.claim import Claim
from services.jobs.clock import iso
from services.jobs.lease import IS_HELD, UNENDED, check_report, close_attempt, stale
from services.jobs.locking import lock_job, lock_job_of


@dataclass(frozen=True)
class Ending:
    """What the end of an attempt meant; ``job_id`` is None when it had been taken before."""

    job_id: str | None
    done: bool
    job_ended: bool = False


_LEAVE = (
    update(trial)
    .where(IS_HELD)
    .values(
        state=bindparam("to_state"),
        robot=bindparam("to_robot"),
        lease_until_s=None,
        faults=trial.c.faults + bindparam("add_faults", type_=Integer),
        outcome=bindparam("to_outcome"),
        log_sha256=bindparam("to_log_sha256"),
        log_bytes=bindparam("to_log_bytes"),
        truth_sha256=bindparam("to_truth_sha256"),
    )
    .returning(trial.c.job_number, trial.c.ordinal, trial.c.faults)
)
OUTAGES = 20
"""So many attempts of a trial may be cut off without counting; one that has more may be what brings them about."""
_PLATFORM_FAULTS = select(func.count()).where(
    attempt.c.trial_id == bindparam("of_trial"), attempt.c.state == AttemptState.PLATFORM_FAULT
)
_LEFT_WITHOUT: dict[str, Any] = {"to_robot": None, "add_faults": 0, "to_outcome": None}
_LEFT_WITHOUT |= {"to_log_sha256": None, "to_log_bytes": None, "to_truth_sha256": None}


async def accept(
    tx: AsyncConnection, now_s: float, trial_id: str, report: OutcomeReport, *, log_bytes: int | None, max_attempts: int
) -> Ending:
    """Takes a robot's outcome; the same outcome again changes nothing.

    Raises:
        Refused: kind and fault do not belong together, or the files are not those that were uploaded under the lease.
        Conflict: the lease is not the robot's any more.
    """
    outcome, claim = report.outcome, Claim(trial_id, report.fence, report.robot)
    if FAULT_OF[outcome.kind] != outcome.fault:
        expected = FAULT_OF[outcome.kind]
        raise Refused("wrong-fault", f"Outcome {outcome.kind} is the fault of {expected}, not of {outcome.fault}; send that.")
    await lock_job_of(tx, trial_id)
    await check_report(tx, claim, report)
    if outcome.fault == Fault.PLATFORM:
        excused = outcome.kind == OutcomeKind.OUT_OF_SPACE
        ending = await fault(tx, now_s, claim, outcome.reason, max_attempts, report=report, excused=excused)
    elif outcome.kind == OutcomeKind.CANCELLED:
        ending = await _stopped(tx, now_s, claim, report, max_attempts)
    else:
        ending = await _done(tx, now_s, claim, report, log_bytes)
    return ending or await _taken_before(tx, claim, outcome)


async def fault(
    tx: AsyncConnection,
    now_s: float,
    claim: Claim,
    reason: str,
    max_attempts: int,
    *,
    report: OutcomeReport | None = None,
    excused: bool = False,
) -> Ending | None:
    """Ends an attempt by the platform's fault; the trial is queued again. None when the claim does not hold any more.

    One is ``excused`` whose robot was cut off, from the API or by a full disk, or was never asked: it counts neither for the
    trial nor for the robot, ``OUTAGES`` times.
    """
    await lock_job_of(tx, claim.trial_id)
    counts = not (excused and await _may_be_an_outage(tx, claim.trial_id))
    moved = await _leave(tx, claim, TrialState.QUEUED, add_faults=int(counts))
    if moved is None:
        return None
    await close_attempt(tx, now_s, claim, AttemptState.PLATFORM_FAULT, reason, report=report)
    if counts:
        await robots.count_fault(tx, claim.robot, reason)
    now = await _record(
        tx,
        now_s,
        moved,
        EventKind.ATTEMPT_FAULTED,
        f"attempt {claim.fence} of trial {moved.ordinal} on {claim.robot} had a platform error: {reason}",
        claim=claim,
        add_platform_faults=1,
    )
    if now.any_robot:
        await pinning.unpin(tx, now.number)
    ended = await _after_fault(tx, now_s, now, moved, claim=claim, reason=reason, max_attempts=max_attempts)
    return Ending(now.job_id, done=False, job_ended=ended)


async def _may_be_an_outage(tx: AsyncConnection, trial_id: str) -> bool:
    counted = (await tx.execute(select(trial.c.faults).where(trial.c.trial_id == trial_id))).scalar_one()
    ended = (await tx.execute(_PLATFORM_FAULTS, {"of_trial": trial_id})).scalar_one()
    return ended - counted < OUTAGES


async def decline(tx: AsyncConnection, now_s: float, claim: Claim, reason: str) -> Ending | None:
    """The robot did not take the offer: the trial is queued again and nothing counts. None when the claim does not hold."""
    await lock_job_of(tx, claim.trial_id)
    moved = await _leave(tx, claim, TrialState.QUEUED)
    if moved is None:
        return None
    await close_attempt(tx, now_s, claim, AttemptState.DECLINED, reason)
    now = await _record(tx, now_s, moved, EventKind.OFFER_DECLINED, f"trial {moved.ordinal} not taken: {reason}", claim=claim)
    if now.any_robot:
        await pinning.unpin(tx, now.number)
    ended = await _cancel_if_unwanted(tx, now_s, now, claim)
    return Ending(now.job_id, done=False, job_ended=ended)


async def _cancel_if_unwanted(tx: AsyncConnection, now_s: float, now: AnyRow, claim: Claim) -> bool:
    """A trial that came back to the queue of a job that was cancelled meanwhile is cancelled too."""
    if not now.cancel_requested and now.state in UNENDED:
        return False
    await tx.execute(update(trial).where(trial.c.trial_id == claim.trial_id).values(state=TrialState.CANCELLED))
    return await end_cancelled(tx, now_s, now)


async def _after_fault(
    tx: AsyncConnection, now_s: float, now: AnyRow, moved: AnyRow, *, claim: Claim, reason: str, max_attempts: int
) -> bool:
    if now.cancel_requested or now.state not in UNENDED:
        return await _cancel_if_unwanted(tx, now_s, now, claim)
    if moved.faults < max_attempts:
        return False
    last = f"the last time on {claim.robot}: {reason}"
    errors = "1 platform error" if moved.faults == 1 else f"{moved.faults} platform errors"
    text = f"trial {moved.ordinal} had {errors}, {last}"
    await cancel_queued(tx, now.number)
    await _end(tx, now_s, now.number, JobState.FAILED, f"job failed: {text}", set_reason=text)
    return True


async def _done(tx: AsyncConnection, now_s: float, claim: Claim, report: OutcomeReport, log_bytes: int | None) -> Ending | None:
    outcome = report.outcome
    kept = {
        "to_outcome": outcome.model_dump_json(),
        "to_log_sha256": report.log_sha256,
        "to_log_bytes": log_bytes,
        "to_truth_sha256": report.truth_sha256,
    }
    moved = await _leave(tx, claim, TrialState.DONE, to_robot=claim.robot, **kept)
    if moved is None:
        return None
    await close_attempt(tx, now_s, claim, AttemptState.ACCEPTED, outcome.reason, report=report)
    of_robot = await robots.count_done(tx, claim.robot)
    counts = {
        "add_trials_done": 1,
        "add_successes": int(outcome.kind == OutcomeKind.SUCCEEDED),
        "add_policy_faults": int(outcome.fault == Fault.POLICY),
    }
    text = f"trial {moved.ordinal} on {claim.robot}: {outcome.kind}"
    now = await _record(tx, now_s, moved, EventKind.TRIAL_DONE, text, claim=claim, **counts)
    await physics.note(tx, now, of_robot)
    return Ending(now.job_id, done=True, job_ended=await _end_if_complete(tx, now_s, now))


async def _end_if_complete(tx: AsyncConnection, now_s: float, now: AnyRow) -> bool:
    if now.state not in UNENDED:
        return False
    # The end of a question's job is its judge's; a large job's report is made first (services/dispatcher/large_jobs.py).
    if now.trials_done < now.trials or now.judged or now.trials_made is not None:
        return now.cancel_requested and await end_cancelled(tx, now_s, now)
    ended = await _end(tx, now_s, now.number, JobState.SUCCEEDED, f"job succeeded: {_did(now)}")
    await reports.write(tx, ended)
    await canary.judge(tx, ended)
    return True


def _did(now: AnyRow) -> str:
    if now.task == TaskName.IDENTIFY:
        return f"excitations recorded: {now.trials}"
    return f"{now.successes} of {now.trials} trials reached their goal"


async def end_large(tx: AsyncConnection, now_s: float, at: str, number: int, report: bytes, told: str) -> bool:
    """Ends a large job all of whose trials are done, with its report and how they ended; false when it has ended otherwise.

    ``at`` is when it ended, as the report says.
    """
    await lock_job(tx, number)
    now = (await tx.execute(select(job).where(job.c.number == number))).one()
    if now.state not in UNENDED or now.cancel_requested or now.trials_done < now.trials:
        return False
    await _end(tx, now_s, number, JobState.SUCCEEDED, f"job succeeded: {_did(now)}", at=at, told=told)
    await reports.store(tx, number, report, at)
    return True


async def _stopped(tx: AsyncConnection, now_s: float, claim: Claim, report: OutcomeReport, max_attempts: int) -> Ending | None:
    asked = select(job.c.cancel_requested, job.c.state).join(trial, trial.c.job_number == job.c.number)
    row = (await tx.execute(asked.where(trial.c.trial_id == claim.trial_id))).one_or_none()
    if row is not None and not row.cancel_requested and row.state in UNENDED:
        reason = f"{claim.robot} stopped the trial though nobody had asked for it"
        return await fault(tx, now_s, claim, reason, max_attempts, report=report)
    moved = await _leave(tx, claim, TrialState.CANCELLED, to_robot=claim.robot, to_outcome=report.outcome.model_dump_json())
    if moved is None:
        return None
    await close_attempt(tx, now_s, claim, AttemptState.CANCELLED, report.outcome.reason, report=report)
    now = await _record(
        tx, now_s, moved, EventKind.TRIAL_CANCELLED, f"trial {moved.ordinal} stopped on {claim.robot}", claim=claim
    )
    return Ending(now.job_id, done=False, job_ended=await end_cancelled(tx, now_s, now))


async def _leave(tx: AsyncConnection, claim: Claim, state: TrialState, **values: Any) -> AnyRow | None:
    """Moves the trial out of this lease; None when the claim does not hold."""
    named = {"of_trial": claim.trial_id, "held_fence": claim.fence, "held_by": claim.robot, "to_state": state}
    return (await tx.execute(_LEAVE, _LEFT_WITHOUT | named | values)).one_or_none()


async def _record(
    tx: AsyncConnection, now_s: float, moved: AnyRow, kind: EventKind, text: str, *, claim: Claim, **changes: Any
) -> AnyRow:
    more: dict[str, Any] = {"ordinal": moved.ordinal, "robot": claim.robot, "add_trials_active": -1, **changes}
    return await events.record(tx, iso(now_s), moved.job_number, kind, text, **more)


async def _taken_before(tx: AsyncConnection, claim: Claim, outcome: Outcome) -> Ending:
    wanted = select(attempt.c.outcome, attempt.c.state).where(
        attempt.c.trial_id == claim.trial_id, attempt.c.fence == claim.fence, attempt.c.robot == claim.robot
    )
    row = (await tx.execute(wanted)).one_or_none()
    if row is not None and row.outcome == outcome.model_dump_json():
        return Ending(None, done=row.state == AttemptState.ACCEPTED)
    raise await stale(tx, claim.trial_id, claim.fence, claim.robot)


async def end_judged(tx: AsyncConnection, now_s: float, number: int, successes: Sequence[bool], text: str) -> str:
    """Ends a job whose question is answered: its report counts the first trials, which ended so; gives the job's id.

    What is queued is taken out of the queue, and robots stop what still runs, as after any end of a job.
    """
    counted = {"counted_trials": len(successes), "counted_successes": sum(successes)}
    await tx.execute(update(job).where(job.c.number == number).values(counted))
    await cancel_queued(tx, number)
    ended = await _end(tx, now_s, number, JobState.SUCCEEDED, f"job succeeded: {text}")
    await reports.write(tx, ended)
    return ended.job_id


async def abandon(tx: AsyncConnection, now_s: float, job_number: int, reason: str) -> bool:
    """Fails a job none of whose trials can run any more; false when it has ended, ends already or still runs one."""
    now = (await tx.execute(select(job).where(job.c.number == job_number).with_for_update())).one()
    if now.state not in UNENDED or now.cancel_requested or now.trials_active > 0:
        return False
    await give_up(tx, now_s, job_number, reason)
    return True


async def unended_of(connection: AsyncConnection, digest: str) -> Sequence[int]:
    """The numbers of the jobs of a policy that have not ended."""
    wanted = select(job.c.number).where(job.c.policy == digest, job.c.state.in_(UNENDED)).order_by(job.c.number)
    return (await connection.execute(wanted)).scalars().all()


async def break_off(tx: AsyncConnection, now_s: float, job_number: int, reason: str) -> str | None:
    """Fails a job whatever of it runs, which robots then stop; gives its id, None when it has ended or ends already."""
    now = (await tx.execute(select(job).where(job.c.number == job_number).with_for_update())).one()
    if now.state not in UNENDED or now.cancel_requested:
        return None
    await give_up(tx, now_s, job_number, reason)
    return now.job_id


async def give_up(tx: AsyncConnection, now_s: float, job_number: int, reason: str) -> None:
    """Fails a job that has not ended."""
    await cancel_queued(tx, job_number)
    await _end(tx, now_s, job_number, JobState.FAILED, f"job failed: {reason}", set_reason=reason)


async def cancel_queued(tx: AsyncConnection, job_number: int) -> None:
    """Takes the job's queued trials out of the queue."""
    queued = update(trial).where(trial.c.job_number == job_number, trial.c.state.in_((TrialState.QUEUED, TrialState.HELD)))
    await tx.execute(queued.values(state=TrialState.CANCELLED))


async def end_cancelled(tx: AsyncConnection, now_s: float, now: AnyRow) -> bool:
    """Ends a cancelled job once no trial of it is active."""
    if now.trials_active > 0 or now.state not in UNENDED:
        return False
    text = f"job cancelled after {now.trials_done} of {now.trials} trials"
    await _end(tx, now_s, now.number, JobState.CANCELLED, text, set_reason="cancelled on request")
    return True


async def _end(
    tx: AsyncConnection,
    now_s: float,
    number: int,
    state: JobState,
    text: str,
    *,
    at: str | None = None,
    told: str | None = None,
    **more: Any,
) -> AnyRow:
    """``told`` says how the trials ended; of a large job it may follow."""
    at = at or iso(now_s)
    await tx.execute(update(webhook).where(webhook.c.job_number == number).values(due_s=now_s))
    ended = await events.record(tx, at, number, EventKind.JOB_ENDED, text, set_state=state, set_ended_at=at, **more)
    if told is None and ended.trials_made is None:
        told = await outcomes.of_job(tx, ended)
    await tx.execute(update(job).where(job.c.number == number).values(outcomes=told))
    return ended
