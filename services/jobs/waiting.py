"""Why a job or a trial is not over yet, in plain words; nothing waits without a reason that can be read."""

from api_schemas.job import FINAL_JOB_STATES
from api_schemas.robot import RobotState
from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.jobs.claim import Claim
from services.jobs.fleet import Fleet, Member
from services.jobs.position import Ahead

NAMED = 8
"""Robots that one sentence names."""


def job_waits(  # noqa: PLR0911  one sentence each
    row: AnyRow, ahead: Ahead, fleet: Fleet, now_s: float, limit: int | None = None
) -> str | None:
    """The sentence for a job; None when it is over."""
    if row.state in FINAL_JOB_STATES:
        return None
    if row.cancel_requested:
        return f"cancelled; {_count(row.trials_active, 'trial')} still being stopped by their robots"
    left = row.trials - row.trials_done - row.trials_active
    if row.trials_active:
        return _running(row.trials_active, left)
    if left == 0 and row.trials_made is not None:
        return "all trials done; its report is being made"
    if left == 0:
        return "all trials done; other jobs of its question or ladder have trials left"
    if begun := min(_begun(row.job_id, fleet, now_s), left):  # since the row was read
        return _running(begun, left - begun)
    if (nobody := _nobody_for(row.robot, _count(left, "trial"), fleet, now_s)) is not None:
        return nobody
    if (others := _others_first(row, ahead, limit)) is not None:
        return others
    return f"{_count(left, 'trial')} about to be leased: {robots_now(fleet, now_s, row.job_id)}"


def _running(running: int, left: int) -> str:
    return f"{_count(running, 'trial')} running{f', {left} more wait for a robot' if left else ''}"


def _begun(job_id: str, fleet: Fleet, now_s: float) -> int:
    """How many robots have begun a trial of the job."""
    of_job = (m for m in fleet.members.values() if (claim := m.lease or m.said_claim()) is not None and _job_of(claim) == job_id)
    return sum(m.state(now_s) in {RobotState.LEASED, RobotState.RUNNING} for m in of_job)


def _job_of(claim: Claim) -> str:
    return claim.trial_id.rpartition("-")[0]


def _others_first(row: AnyRow, ahead: Ahead, limit: int | None) -> str | None:
    """What has to run before the job's first trial does; None when nothing has to."""
    if limit is not None and ahead.running_of_owner >= limit:
        return f"{_count(ahead.running_of_owner, 'trial')} of {row.owner} running, and a user may have {limit} at the same time"
    if ahead.trials == 0:
        return None
    about = "" if ahead.wait_s is None else f", about {_lasting(ahead.wait_s)}"
    return f"{_count(ahead.trials, 'trial')} {_are(ahead.trials)} ahead{about}"


def trial_waits(row: AnyRow, job: AnyRow, fleet: Fleet, now_s: float, before: int) -> str | None:
    """The sentence for a trial; ``before`` counts the job's earlier queued trials. None when the trial is over."""
    if row.state == TrialState.RUNNING:
        return f"running on {row.robot}"
    if row.state == TrialState.LEASED:
        return f"leased to {row.robot}, waiting for its answer"
    if row.state != TrialState.QUEUED:
        held = f"the goals before it may end job {job.job_id}; it is queued when they have not"
        return held if row.state == TrialState.HELD else None
    if (nobody := _nobody_for(job.robot, "it", fleet, now_s)) is not None:
        return nobody
    if row.first_choice is None:
        return f"{_count(before, 'queued trial')} of job {job.job_id} before it; its robot is drawn when its turn comes"
    member = fleet.snapshot(row.first_choice)
    doing = "has not been seen since the services started" if member is None else robot_now(member, now_s, job.job_id)
    return f"{row.first_choice}, drawn for this trial, {doing}"


def _nobody_for(pinned: str | None, what: str, fleet: Fleet, now_s: float) -> str | None:
    """Why no robot can run ``what``, where only the ``pinned`` robot may if there is one; None when one is in service."""
    if fleet.held_back is not None:
        return fleet.held_back
    if pinned is None:
        return None if fleet.serves(now_s) else nobody_in_service(fleet, now_s)
    member = fleet.snapshot(pinned)
    if member is None:
        return f"{what} must run on {pinned}, which has not been seen since the services started"
    return None if member.healthy(now_s) else f"{what} must run on {pinned}, which {robot_now(member, now_s)}"


def nobody_in_service(fleet: Fleet, now_s: float) -> str:
    """Why no trial can be leased at all."""
    if not fleet.members:
        return "no robot is in service: none has joined the farm yet"
    return f"no robot is in service: {robots_now(fleet, now_s)}"


def robots_now(fleet: Fleet, now_s: float, of_job: str | None = None) -> str:
    """Robots and what they do, in one line; of many the first by name."""
    first = [fleet.members[robot] for robot in sorted(fleet.members)[:NAMED]]
    said = ", ".join(f"{member.robot} {robot_now(member, now_s, of_job)}" for member in first)
    return said if len(first) == len(fleet.members) else f"{said}, and {len(fleet.members) - len(first)} more"


def robot_now(member: Member, now_s: float, of_job: str | None = None) -> str:
    """What a robot does, as the end of a sentence that begins with its name; it names trials of this job alone."""
    state = member.state(now_s)
    said = member.heartbeat
    reason = f" ({why})" if (why := member.reason(now_s)) else ""
    busy = member.lease or member.said_claim()
    match state:
        case RobotState.LOST:
            since = member.lost_s if member.lost_s is not None else member.seen_s
            return "has not reported yet" if said is None else f"has been silent for {_lasting(now_s - since)}"
        case RobotState.RUNNING | RobotState.LEASED:
            return f"is running {_trial(busy.trial_id, of_job)}" if busy else f"is {state}{reason}"
        case RobotState.DRAINING:
            return "is draining" + (f" and still running {_trial(member.lease.trial_id, of_job)}" if member.lease else reason)
        case RobotState.OUT_OF_SERVICE:
            return f"is out of service{reason}"
        case _:
            return "is idle"


def _trial(trial_id: str, of_job: str | None) -> str:
    """Sentences are read by the owner of one job; what others run is nobody's business but theirs."""
    if of_job is None:
        return "a trial"
    return f"trial {trial_id}" if trial_id.rpartition("-")[0] == of_job else "a trial of another job"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _lasting(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"


def _are(number: int) -> str:
    return "is" if number == 1 else "are"
