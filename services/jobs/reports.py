"""The report of a job: written once, in the transaction that ends the job, and served ever after as it was stored.

That of a large job is made before, from pages of its trials (``services/dispatcher/large_jobs.py``).
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from sqlalchemy import insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.anytime import rate_sequence
from api_schemas.excitation import ExcitationName
from api_schemas.jail_report import JailReport, weakest
from api_schemas.job import TaskName
from api_schemas.physics import ObjectName
from api_schemas.question import Question
from api_schemas.report import (
    LISTED,
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

AT_ONCE = 500
"""Trials whose attempts one statement reads."""
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
    attempts = await attempts_of(tx, trials)
    if job.task == TaskName.IDENTIFY:
        composed = compose_identification(job, trials, attempts, versions())
    else:
        composed = compose(job, trials, attempts, versions(), await questions.of_job(tx, job))
    await store(tx, job.number, body_of(composed), job.ended_at)


def versions() -> dict[str, str]:
    """Of what made a report."""
    return {"trifarm": version("trifarm")}


def body_of(composed: Report | IdentificationReport) -> bytes:
    """The bytes of a report."""
    return json.dumps(composed.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


async def store(tx: AsyncConnection, job_number: int, body: bytes, at: str) -> None:
    """Stores the bytes of a job's report."""
    sha256 = hashlib.sha256(body).hexdigest()
    await tx.execute(insert(report).values(job_number=job_number, body=body, sha256=sha256, created_at=at))


async def attempts_of(connection: AsyncConnection, trials: Sequence[AnyRow]) -> Sequence[AnyRow]:
    """The attempts of some trials that robots took, in the order of the trials."""
    ordinals = {row.trial_id: row.ordinal for row in trials}
    found: list[AnyRow] = []
    names = list(ordinals)
    for first in range(0, len(names), AT_ONCE):
        wanted = select(attempt).where(attempt.c.trial_id.in_(names[first : first + AT_ONCE]))
        found += await connection.execute(wanted.where(attempt.c.state != AttemptState.DECLINED))
    return sorted(found, key=lambda row: (ordinals[row.trial_id], row.fence))


def compose(
    job: AnyRow,
    trials: Sequence[AnyRow],
    attempts: Sequence[AnyRow],
    versions: dict[str, str],
    question: Question | None = None,
) -> Report:
    """The report from a job's rows."""
    tally = Tally()
    tally.add(trials, attempts)
    return tally.report(job, job.ended_at, versions, question)


@dataclass
class OfRobot:
    """What one robot did of a job."""

    trials: int = 0
    successes: int = 0
    platform_faults: int = 0


@dataclass
class Tally:
    """What a report says of trials, counted page by page, in the order of the trials."""

    listed: list[TrialRow] = field(default_factory=list)
    faults: list[FaultRow] = field(default_factory=list)
    trials: int = 0
    attempts: int = 0
    successes: int = 0
    success_ever: int = 0
    policy_faults: int = 0
    success_fractions: list[float] = field(default_factory=list)
    returns: list[float] = field(default_factory=list)
    timing: TimingRow | None = None
    jail: JailReport | None = None
    failures: dict[str, tuple[list[int], str]] = field(default_factory=dict)
    robots: dict[str, OfRobot] = field(default_factory=lambda: defaultdict(OfRobot))
    forms: set[str] = field(default_factory=set)
    trackers: set[str] = field(default_factory=set)

    def add(self, trials: Sequence[AnyRow], attempts: Sequence[AnyRow]) -> None:
        """Counts the next trials, with all of their attempts."""
        of_trials = _of_trials(attempts)
        for row in trials:
            self._add(_trial_row(row, of_trials[row.trial_id]))
            for each in of_trials[row.trial_id]:
                if each.state == AttemptState.PLATFORM_FAULT:
                    self.faults.append(_fault_row(each, row.ordinal))
                    self.robots[each.robot].platform_faults += 1
        self.attempts += len(attempts)

    def _add(self, row: TrialRow) -> None:
        outcome, of_robot = row.outcome, self.robots[row.robot]
        if self.trials < LISTED:
            self.listed.append(row)
        succeeded = outcome.kind == OutcomeKind.SUCCEEDED
        self.trials, of_robot.trials = self.trials + 1, of_robot.trials + 1
        self.successes, of_robot.successes = self.successes + succeeded, of_robot.successes + succeeded
        self.policy_faults += outcome.fault == Fault.POLICY
        if outcome.measures is not None:
            self.success_ever += outcome.measures.success_ever
            self.success_fractions.append(outcome.measures.success_fraction)
            self.returns.append(outcome.measures.episode_return)
        self.timing = _timing(self.timing, outcome)
        self.jail = weakest((self.jail, outcome.jail))
        if (failed := _failure(outcome)) is not None:
            kind, sentence = failed
            self.failures.setdefault(kind, ([], sentence))[0].append(row.trial)
        self.forms.add(form_or_first(outcome.form))
        self.trackers.add(outcome.tracker.value)

    def report(self, job: AnyRow, ended_at: str, versions: dict[str, str], question: Question | None) -> Report:
        """The report of the job that these are all counted trials of.

        The intervals of a job that a question may have ended are of its confidence sequence: an end that depends on what was
        seen makes others too narrow.
        """
        interval = rate_sequence if job.judged else wilson
        return Report(
            job_id=job.job_id,
            task=job.task,
            object=ObjectName(job.object),
            object_scale=job.object_scale,
            policy=job.policy,
            policy_name=job.policy_name,
            seed=job.seed,
            trials=self.trials,
            successes=self.successes,
            success_rate=self.successes / self.trials,
            interval_80=interval(self.successes, self.trials, 0.80),
            interval_95=interval(self.successes, self.trials, 0.95),
            intervals="sequence" if job.judged else "wilson",
            question=question,
            uncounted=max(0, job.trials_done - self.trials),
            own_goals=job.own_goals,
            recipe=job.recipe,
            training_seed=job.training_seed,
            success_ever=self.success_ever,
            mean_success_fraction=_mean(self.success_fractions),
            mean_return=_mean(self.returns),
            policy_faults=self.policy_faults,
            platform_faults=len(self.faults),
            attempts=self.attempts,
            timing=self.timing,
            between_robots=self._between_robots(),
            jail=self.jail,
            failures=self._failures(),
            per_robot=tuple(_robot_row(name, did) for name, did in sorted(self.robots.items())),
            per_trial=tuple(self.listed),
            platform_fault_attempts=tuple(self.faults),
            created_at=job.created_at,
            started_at=job.started_at,
            ended_at=ended_at,
            versions=versions,
            forms=tuple(sorted(self.forms)),
            trackers=() if self.trackers <= {TrackerName.POSE.value} else tuple(sorted(self.trackers)),
        )

    def _failures(self) -> tuple[FailureRow, ...]:
        ordered = sorted(self.failures.items(), key=lambda each: (-len(each[1][0]), each[0]))
        return tuple(FailureRow(kind=kind, trials=tuple(found), sentence=first) for kind, (found, first) in ordered)

    def _between_robots(self) -> BetweenRobots | None:
        did = [each for _, each in sorted(self.robots.items()) if each.trials]
        share = variance_share([each.successes for each in did], [each.trials for each in did], 0.80)
        if share is None:
            return None
        return BetweenRobots(variance_share=share.estimate, interval_80=share.interval, robots=len(did))


def compose_identification(
    job: AnyRow, trials: Sequence[AnyRow], attempts: Sequence[AnyRow], versions: dict[str, str]
) -> IdentificationReport:
    """The report of an identification: what was recorded where."""
    of_trials = _of_trials(attempts)
    ordinals = {row.trial_id: row.ordinal for row in trials}
    faults = tuple(_fault_row(row, ordinals[row.trial_id]) for row in attempts if row.state == AttemptState.PLATFORM_FAULT)
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


def _failure(outcome: Outcome) -> tuple[str, str] | None:
    """Kind and sentence of a failure. Policy errors are kinds of their own: they say what was wrong themselves."""
    if outcome.failure is not None:
        return outcome.failure.kind, outcome.failure.sentence
    return (outcome.kind, outcome.reason) if outcome.fault == Fault.POLICY else None


def _fault_row(row: AnyRow, ordinal: int) -> FaultRow:
    return FaultRow(trial=ordinal, attempt=row.fence, robot=row.robot, reason=row.reason or "")


def _robot_row(name: str, did: OfRobot) -> RobotRow:
    return RobotRow(
        robot=name,
        trials=did.trials,
        successes=did.successes,
        success_rate=did.successes / did.trials if did.trials else 0.0,
        interval_80=wilson(did.successes, did.trials, 0.80),
        platform_faults=did.platform_faults,
    )


def _timing(so_far: TimingRow | None, outcome: Outcome) -> TimingRow | None:
    """The slowest trial's 99th percentile stands for all: percentiles cannot be averaged, and one slow robot counts."""
    timing = outcome.policy_timing
    if timing is None or outcome.measures is None:
        return so_far
    actions, missed = outcome.measures.control_steps, timing.missed
    p99_ms, max_ms, allowed_ms = timing.p99_ms, timing.max_ms, timing.allowed_ms
    if so_far is not None:
        actions, missed = so_far.actions + actions, so_far.missed + missed
        p99_ms, max_ms = max(so_far.p99_ms, p99_ms), max(so_far.max_ms, max_ms)
        allowed_ms = min(so_far.allowed_ms, allowed_ms)
    keeps = missed <= KEEPS_RATE_MISSED * actions
    return TimingRow(p99_ms=p99_ms, max_ms=max_ms, allowed_ms=allowed_ms, missed=missed, actions=actions, keeps_rate=keeps)


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
