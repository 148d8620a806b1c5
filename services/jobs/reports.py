"""The report of a job: written once, in the transaction that ends the job, and served ever after as it was stored."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from sqlalchemy import insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.anytime import rate_sequence
from api_schemas.excitation import ExcitationName
from api_schemas.jail_report import weakest
from api_schemas.job import TaskName
from api_schemas.physics import ObjectName
from api_schemas.question import Question
from api_schemas.report import (
    BetweenRobots,
    ExcitationRow,
    FailureRow,
    FaultRow,
    IdentificationReport,
    Report,
    RobotRow,
    TimingRow,
    TrialRow,
)
from api_schemas.scene_form import form_or_first
from api_schemas.signature import Signature, unsigned
from api_schemas.success_rate import wilson
from api_schemas.tracker import TrackerName
from api_schemas.trial import AttemptState, Fault, Outcome, OutcomeKind
from services.database.database import Database
from services.database.rows import AnyRow
from services.database.tables import attempt, report, trial
from services.errors import Conflict
from services.jobs import questions, views
from services.jobs.fleet import Fleet
from services.jobs.variance_share import variance_share
from services.signing import FarmKey

KEEPS_RATE_MISSED = 0.01
"""A policy keeps its rate when at most this share of its actions came late: then their 99th percentile is in time."""


async def stored(
    database: Database, fleet: Fleet, now_s: float, job_id: str, owner: str | None, user_trials_at_once: int | None
) -> tuple[bytes, str]:
    """The report of a job as it was written, and its SHA-256; with ``owner`` only if the job is theirs.

    Raises:
        NotFound: there is no such job.
        Conflict: it has no report.
    """
    async with database.read() as connection:
        row = await views.job_row(connection, job_id, owner)
        found = (await connection.execute(select(report).where(report.c.job_number == row.number))).one_or_none()
        if found is not None:
            return found.body, found.sha256
        (shown,) = await views.show_jobs(connection, [row], fleet, now_s, user_trials_at_once)
    why = shown.waiting_because or shown.reason
    detail = f"Job {job_id} is {shown.state} and has no report{f': {why}' if why else ''}."
    raise Conflict("report-not-ready", detail, state=shown.state, waiting_because=shown.waiting_because)


def sign(body: dict[str, Any], key: FarmKey) -> Signature:
    """The farm's word for a report."""
    wanted = unsigned(key.public_hex, body)
    return wanted.model_copy(update={"signature": key.sign(wanted.signed_bytes())})


async def write(tx: AsyncConnection, job: AnyRow) -> None:
    """Composes the report of a job whose trials are all done, and stores its bytes."""
    counted = job.trials if job.counted_trials is None else job.counted_trials
    own = select(trial).where(trial.c.job_number == job.number, trial.c.ordinal < counted)
    trials = (await tx.execute(own.order_by(trial.c.ordinal))).all()
    wanted = (
        select(attempt, trial.c.ordinal)
        .join(trial, trial.c.trial_id == attempt.c.trial_id)
        .where(attempt.c.job_number == job.number, attempt.c.state != AttemptState.DECLINED, trial.c.ordinal < counted)
        .order_by(trial.c.ordinal, attempt.c.fence)
    )
    attempts = (await tx.execute(wanted)).all()
    versions = {"trifarm": version("trifarm")}
    if job.task == TaskName.IDENTIFY:
        composed = compose_identification(job, trials, attempts, versions)
    else:
        composed = compose(job, trials, attempts, versions, await questions.of_job(tx, job))
    body = json.dumps(composed.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    sha256 = hashlib.sha256(body).hexdigest()
    await tx.execute(insert(report).values(job_number=job.number, body=body, sha256=sha256, created_at=job.ended_at))


def compose(
    job: AnyRow,
    trials: Sequence[AnyRow],
    attempts: Sequence[AnyRow],
    versions: dict[str, str],
    question: Question | None = None,
) -> Report:
    """The report from a job's rows; ``attempts`` carry their trial's ordinal.

    The intervals of a job that a question may have ended are of its confidence sequence: an end that depends on what was seen
    makes others too narrow.
    """
    interval = rate_sequence if job.judged else wilson
    of_trials = _of_trials(attempts)
    rows = tuple(_trial_row(row, of_trials[row.trial_id]) for row in trials)
    outcomes = [row.outcome for row in rows]
    measures = [outcome.measures for outcome in outcomes if outcome.measures is not None]
    successes = sum(outcome.kind == OutcomeKind.SUCCEEDED for outcome in outcomes)
    faults = tuple(_fault_row(row) for row in attempts if row.state == AttemptState.PLATFORM_FAULT)
    return Report(
        job_id=job.job_id,
        task=job.task,
        object=ObjectName(job.object),
        object_scale=job.object_scale,
        policy=job.policy,
        policy_name=job.policy_name,
        seed=job.seed,
        trials=len(rows),
        successes=successes,
        success_rate=successes / len(rows),
        interval_80=interval(successes, len(rows), 0.80),
        interval_95=interval(successes, len(rows), 0.95),
        intervals="sequence" if job.judged else "wilson",
        question=question,
        uncounted=max(0, job.trials_done - len(rows)),
        own_goals=job.own_goals,
        recipe=job.recipe,
        training_seed=job.training_seed,
        success_ever=sum(measure.success_ever for measure in measures),
        mean_success_fraction=_mean([measure.success_fraction for measure in measures]),
        mean_return=_mean([measure.episode_return for measure in measures]),
        policy_faults=sum(outcome.fault == Fault.POLICY for outcome in outcomes),
        platform_faults=len(faults),
        attempts=len(attempts),
        timing=_timing(outcomes),
        between_robots=_between_robots(rows),
        jail=weakest(outcome.jail for outcome in outcomes),
        failures=_failures(rows),
        per_robot=_robot_rows(rows, faults),
        per_trial=rows,
        platform_fault_attempts=faults,
        created_at=job.created_at,
        started_at=job.started_at,
        ended_at=job.ended_at,
        versions=versions,
        forms=_forms(outcomes),
        trackers=_trackers(outcomes),
    )


def compose_identification(
    job: AnyRow, trials: Sequence[AnyRow], attempts: Sequence[AnyRow], versions: dict[str, str]
) -> IdentificationReport:
    """The report of an identification: what was recorded where."""
    faults = tuple(_fault_row(row) for row in attempts if row.state == AttemptState.PLATFORM_FAULT)
    of_trials = _of_trials(attempts)
    rows = tuple(_excitation_row(row, len(of_trials[row.trial_id])) for row in trials)
    return IdentificationReport(
        job_id=job.job_id,
        task=job.task,
        object=ObjectName(job.object),
        object_scale=job.object_scale,
        robot=job.robot,
        seed=job.seed,
        trials=len(trials),
        platform_faults=len(faults),
        attempts=len(attempts),
        per_trial=rows,
        platform_fault_attempts=faults,
        created_at=job.created_at,
        started_at=job.started_at,
        ended_at=job.ended_at,
        versions=versions,
        forms=_forms(row.outcome for row in rows),
    )


def _forms(outcomes: Iterable[Outcome]) -> tuple[str, ...]:
    """The forms of the scene that the trials were done with; one, unless robots were exchanged meanwhile."""
    return tuple(sorted({form_or_first(outcome.form) for outcome in outcomes}))


def _trackers(outcomes: Iterable[Outcome]) -> tuple[str, ...]:
    """What found the object in the trials; nothing where it was the formula in all of them."""
    found = {outcome.tracker.value for outcome in outcomes}
    return () if found <= {TrackerName.POSE.value} else tuple(sorted(found))


def _of_trials(attempts: Sequence[AnyRow]) -> Mapping[str, Sequence[AnyRow]]:
    """The attempts of each trial, in their order."""
    found = defaultdict[str, list[AnyRow]](list)
    for each in attempts:
        found[each.trial_id].append(each)
    return found


def _excitation_row(row: AnyRow, attempts: int) -> ExcitationRow:
    return ExcitationRow(
        trial=row.ordinal,
        trial_id=row.trial_id,
        excitation=ExcitationName(row.excitation),
        robot=row.robot,
        seed=row.seed,
        attempts=attempts,
        outcome=Outcome.model_validate_json(row.outcome),
        log_sha256=row.log_sha256,
    )


def _trial_row(row: AnyRow, own: Sequence[AnyRow]) -> TrialRow:
    return TrialRow(
        trial=row.ordinal,
        trial_id=row.trial_id,
        robot=row.robot,
        seed=row.seed,
        attempts=len(own),
        outcome=Outcome.model_validate_json(row.outcome),
        departure=own[-1].departure,
        log_sha256=row.log_sha256,
    )


def _failures(rows: Sequence[TrialRow]) -> tuple[FailureRow, ...]:
    """Failed trials by kind. Policy errors are kinds of their own: they say what was wrong themselves."""
    of_kind: dict[str, list[tuple[int, str]]] = {}
    for row in rows:
        if row.outcome.failure is not None:
            of_kind.setdefault(row.outcome.failure.kind, []).append((row.trial, row.outcome.failure.sentence))
        elif row.outcome.fault == Fault.POLICY:
            of_kind.setdefault(row.outcome.kind, []).append((row.trial, row.outcome.reason))
    ordered = sorted(of_kind.items(), key=lambda each: (-len(each[1]), each[0]))
    return tuple(
        FailureRow(kind=kind, trials=tuple(number for number, _ in found), sentence=found[0][1]) for kind, found in ordered
    )


def _fault_row(row: AnyRow) -> FaultRow:
    return FaultRow(trial=row.ordinal, attempt=row.fence, robot=row.robot, reason=row.reason or "")


def _robot_rows(rows: Sequence[TrialRow], faults: Sequence[FaultRow]) -> tuple[RobotRow, ...]:
    names = sorted({row.robot for row in rows} | {row.robot for row in faults})
    return tuple(_robot_row(name, [row for row in rows if row.robot == name], faults) for name in names)


def _robot_row(name: str, rows: Sequence[TrialRow], faults: Sequence[FaultRow]) -> RobotRow:
    successes = sum(row.outcome.kind == OutcomeKind.SUCCEEDED for row in rows)
    return RobotRow(
        robot=name,
        trials=len(rows),
        successes=successes,
        success_rate=successes / len(rows) if rows else 0.0,
        interval_80=wilson(successes, len(rows), 0.80),
        platform_faults=sum(row.robot == name for row in faults),
    )


def _between_robots(rows: Sequence[TrialRow]) -> BetweenRobots | None:
    names = sorted({row.robot for row in rows})
    trials = [sum(row.robot == name for row in rows) for name in names]
    successes = [sum(row.robot == name and row.outcome.kind == OutcomeKind.SUCCEEDED for row in rows) for name in names]
    share = variance_share(successes, trials, 0.80)
    if share is None:
        return None
    return BetweenRobots(variance_share=share.estimate, interval_80=share.interval, robots=len(names))


def _timing(outcomes: Sequence[Outcome]) -> TimingRow | None:
    """The slowest trial's 99th percentile stands for all: percentiles cannot be averaged, and one slow robot counts."""
    timed = [o for o in outcomes if o.policy_timing is not None and o.measures is not None]
    timings = [o.policy_timing for o in timed if o.policy_timing is not None]
    if not timings:
        return None
    actions = sum(o.measures.control_steps for o in timed if o.measures is not None)
    missed = sum(timing.missed for timing in timings)
    return TimingRow(
        p99_ms=max(timing.p99_ms for timing in timings),
        max_ms=max(timing.max_ms for timing in timings),
        allowed_ms=min(timing.allowed_ms for timing in timings),
        missed=missed,
        actions=actions,
        keeps_rate=missed <= KEEPS_RATE_MISSED * actions,
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
