"""What the API shows of jobs, trials and robots, read from the database and the fleet."""

import json
from collections import defaultdict
from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.excitation import ExcitationName
from api_schemas.goal import OwnGoal
from api_schemas.job import Job, JobState, TaskName
from api_schemas.physics import ObjectName
from api_schemas.robot import Robot, RobotState
from api_schemas.trial import Attempt, AttemptState, Outcome, Trial, TrialState
from services.database.rows import AnyRow
from services.database.tables import attempt, job, trial
from services.errors import NotFound
from services.jobs import questions
from services.jobs.clock import iso
from services.jobs.fleet import Fleet, Member
from services.jobs.lease import UNENDED
from services.jobs.position import Ahead, ahead_of
from services.jobs.priority import priority_of
from services.jobs.waiting import job_waits, trial_waits


async def job_row(connection: AsyncConnection, job_id: str, owner: str | None) -> AnyRow:
    """A job's row; with ``owner`` only if it is theirs.

    Raises:
        NotFound: there is no such job, or it is another's.
    """
    row = (await connection.execute(select(job).where(job.c.job_id == job_id))).one_or_none()
    if row is None or owner not in (None, row.owner):
        raise NotFound("job-not-found", f"There is no job {job_id} of yours; GET /v1/jobs lists them.")
    return row


async def show_jobs(
    connection: AsyncConnection, rows: Sequence[AnyRow], fleet: Fleet, now_s: float, limit: int | None = None
) -> tuple[Job, ...]:
    """The jobs, each with the reason why it waits; ``limit`` is how many trials a user may have running."""
    ahead = await ahead_of(connection, rows, len(fleet.healthy(now_s)))
    return tuple([_job(row, ahead.get(row.number), fleet, now_s, limit) for row in rows])


def _job(row: AnyRow, ahead: Ahead | None, fleet: Fleet, now_s: float, limit: int | None) -> Job:
    return Job(
        queue_position=None if ahead is None else ahead.trials + 1,
        estimated_wait_s=None if ahead is None or ahead.wait_s is None else round(ahead.wait_s, 1),
        waiting_because=job_waits(row, ahead or Ahead(0), fleet, now_s, limit),
        job_id=row.job_id,
        state=JobState(row.state),
        policy=row.policy,
        policy_name=row.policy_name,
        task=TaskName(row.task),
        object=ObjectName(row.object),
        object_scale=row.object_scale,
        priority=priority_of(row.priority),
        robot=row.robot,
        trials=row.trials,
        seed=row.seed,
        seed_drawn_by_server=row.seed_drawn_by_server,
        owner=row.owner,
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
        trials_done=row.trials_done,
        trials_running=row.trials_active,
        successes=row.successes,
        policy_faults=row.policy_faults,
        platform_faults=row.platform_faults,
        reason=row.reason,
        own_goals=row.own_goals,
        images=row.images,
        recipe=row.recipe,
        training_seed=row.training_seed,
        name=row.name,
        note=row.note,
    )


async def show_question(connection: AsyncConnection, row: AnyRow, shown: Job) -> Job:
    """The job with the question that ends it, if there is one."""
    question = await questions.of_job(connection, row)
    return shown if question is None else shown.model_copy(update={"question": question})


async def show_trials(
    connection: AsyncConnection, owner_job: AnyRow, rows: Sequence[AnyRow], fleet: Fleet, now_s: float
) -> tuple[Trial, ...]:
    """Trials of the job that follow each other in its order, with their attempts."""
    ids = [row.trial_id for row in rows]
    of_these = select(attempt).where(attempt.c.trial_id.in_(ids)).order_by(attempt.c.trial_id, attempt.c.fence)
    attempts = (await connection.execute(of_these)).all()
    of_each: defaultdict[str, list[Attempt]] = defaultdict(list)
    for each in attempts:
        of_each[each.trial_id].append(_attempt(each))
    before, shown = await _queued_before(connection, owner_job, rows), []
    for row in rows:
        waits = trial_waits(row, owner_job, fleet, now_s, before)
        shown.append(_trial(row, owner_job, tuple(of_each[row.trial_id]), waits))
        before += row.state == TrialState.QUEUED
    return tuple(shown)


async def _queued_before(connection: AsyncConnection, owner_job: AnyRow, rows: Sequence[AnyRow]) -> int:
    """How many of the job's trials are queued before the first of these, which follow each other."""
    if owner_job.state not in UNENDED or not any(row.state == TrialState.QUEUED for row in rows):
        return 0
    before = select(func.count()).where(trial.c.job_number == owner_job.number, trial.c.ordinal < rows[0].ordinal)
    return (await connection.execute(before.where(trial.c.state == TrialState.QUEUED))).scalar_one()


def _trial(row: AnyRow, owner_job: AnyRow, attempts: tuple[Attempt, ...], waiting_because: str | None) -> Trial:
    return Trial(
        trial_id=row.trial_id,
        job_id=owner_job.job_id,
        ordinal=row.ordinal,
        state=TrialState(row.state),
        waiting_because=waiting_because,
        task=owner_job.task,
        seed=row.seed,
        robot=row.robot,
        robot_order=tuple(json.loads(row.robot_order)),
        outcome=None if row.outcome is None else Outcome.model_validate_json(row.outcome),
        log_sha256=row.log_sha256,
        log_bytes=row.log_bytes,
        attempts=attempts,
        excitation=None if row.excitation is None else ExcitationName(row.excitation),
        has_truth=row.truth_sha256 is not None,
        own_goal=None if row.own_goal is None else OwnGoal.model_validate_json(row.own_goal),
    )


def _attempt(row: AnyRow) -> Attempt:
    return Attempt(
        fence=row.fence,
        robot=row.robot,
        state=AttemptState(row.state),
        reason=row.reason,
        departure=row.departure,
        started_at=row.started_at,
        ended_at=row.ended_at,
        log_sha256=row.log_sha256,
    )


def show_robot(member: Member, now_s: float) -> Robot:
    """A robot as it is seen now."""
    said, state = member.heartbeat, member.state(now_s)
    return Robot(
        robot=member.robot,
        state=state,
        pid=None if said is None else said.pid,
        host=None if said is None else said.host,
        trial=None if member.lease is None else member.lease.trial_id,
        job=None if member.lease is None else member.lease.trial_id.rpartition("-")[0],
        reason=_reason(member, state, now_s),
        simulated_s=member.simulated_s,
        last_seen_at=iso(member.seen_s) if said is not None else None,
        trials_done=member.trials_done,
        health=None if said is None else said.health,
    )


def _reason(member: Member, state: RobotState, now_s: float) -> str | None:
    if not member.drain or state == RobotState.OUT_OF_SERVICE:
        return member.reason(now_s)
    if state != RobotState.DRAINING:
        return "drained by an operator"
    said = member.said_claim()  # of a lease that another process of the services gave, too
    runs = member.lease is not None or (said is not None and said != member.ended)
    return f"drained by an operator: {'finishes its trial first' if runs else 'runs nothing and may be switched off'}"
