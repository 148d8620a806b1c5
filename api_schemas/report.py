"""The report of a job: outcomes and statistics, written last and never changed."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from api_schemas.excitation import ExcitationName
from api_schemas.jail_report import JailReport
from api_schemas.physics import ObjectName
from api_schemas.question import Question
from api_schemas.schema import Schema
from api_schemas.trial import Outcome

LISTED = 1000
"""Trials that a report lists one by one, the first of its job; its numbers are of all."""


class RobotRow(Schema):
    """One robot's share of a job."""

    robot: str
    trials: int
    successes: int
    success_rate: float
    interval_80: tuple[float, float]
    platform_faults: int


class TrialRow(Schema):
    """One accepted outcome."""

    trial: int
    trial_id: str
    robot: str
    seed: int
    attempts: int
    outcome: Outcome
    departure: str | None
    log_sha256: str | None


class FaultRow(Schema):
    """One attempt that failed by the platform's fault; it is not counted."""

    trial: int
    attempt: int
    robot: str
    reason: str


class FailureRow(Schema):
    """Trials that failed for one kind of reason, as measured numbers tell it; the sentence is that of the first."""

    kind: str
    trials: tuple[int, ...]
    sentence: str


class TimingRow(Schema):
    """Would the policy keep its rate on hardware? Over all trials of the job."""

    p99_ms: float
    max_ms: float
    allowed_ms: float
    missed: int
    actions: int
    keeps_rate: bool


class BetweenRobots(Schema):
    """How much of the variance of success lies between robots: 0 when all are alike, 1 when each always ends the same.

    The robots stand for all that the farm could have drawn; services/jobs/variance_share.py says how it is estimated.
    """

    variance_share: float = Field(ge=0, le=1)
    interval_80: tuple[float, float]
    robots: int


class Report(Schema):
    """What a job achieved: its success rate, robots, trials and errors. Intervals of rates are Wilson's, as fractions.

    Those of the whole job are a confidence sequence where ``intervals`` says so.
    """

    format: Literal["trifarm-report/1"] = "trifarm-report/1"
    job_id: str
    task: str
    object: ObjectName = ObjectName.CUBE
    object_scale: float = 1.0
    policy: str
    policy_name: str
    seed: int
    trials: int
    successes: int
    success_rate: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]
    intervals: Literal["wilson", "sequence"] = Field(
        default="wilson", description="of the job's rate; those of a question's job are a confidence sequence"
    )
    question: Question | None = Field(default=None, description="what the job was to find out, and what was found")
    uncounted: int = Field(default=0, description="trials that had ended when the question was answered by those before them")
    own_goals: bool = Field(default=False, description="whether the job's user brought its goals")
    recipe: str | None = Field(default=None, description="the training that the policy is one seed of, in its user's words")
    training_seed: int | None = None
    success_ever: int
    mean_success_fraction: float | None
    mean_return: float | None
    policy_faults: int
    platform_faults: int = Field(description="attempts that failed by the platform's fault; never counted in the rate")
    attempts: int
    timing: TimingRow | None
    between_robots: BetweenRobots | None = None
    jail: JailReport | None = Field(default=None, description="the most open one that the policy ran in")
    failures: tuple[FailureRow, ...] = Field(default=(), description="by kind, the most frequent first")
    per_robot: tuple[RobotRow, ...]
    per_trial: tuple[TrialRow, ...] = Field(description=f"the first {LISTED}; GET /v1/jobs/ID/trials has all")
    platform_fault_attempts: tuple[FaultRow, ...]
    created_at: str
    started_at: str | None
    ended_at: str
    versions: dict[str, str]
    forms: tuple[str, ...] = Field(default=(), description="of the scene, one for all trials; empty in reports of 0.1.0")
    trackers: tuple[str, ...] = Field(
        default=(), exclude_if=lambda trackers: not trackers, description="what found the object; left out where all is of pose"
    )


class ExcitationRow(Schema):
    """One accepted recording of an excitation."""

    trial: int
    trial_id: str
    excitation: ExcitationName
    robot: str
    seed: int
    attempts: int
    outcome: Outcome
    log_sha256: str | None


class IdentificationReport(Schema):
    """What an identification recorded. There is nothing to succeed in, so that it has no rates."""

    format: Literal["trifarm-identification/1"] = "trifarm-identification/1"
    job_id: str
    task: str
    object: ObjectName
    object_scale: float
    robot: str
    seed: int
    trials: int
    platform_faults: int
    attempts: int
    per_trial: tuple[ExcitationRow, ...]
    platform_fault_attempts: tuple[FaultRow, ...]
    created_at: str
    started_at: str | None
    ended_at: str
    versions: dict[str, str]
    forms: tuple[str, ...] = Field(default=(), description="of the scene, one for all trials; empty in reports of 0.1.0")


AnyReport = Annotated[Report | IdentificationReport, Field(discriminator="format")]
_ANY_REPORT: TypeAdapter[Report | IdentificationReport] = TypeAdapter(AnyReport)


def read_report(body: bytes) -> Report | IdentificationReport:
    """A stored report of either kind."""
    return _ANY_REPORT.validate_json(body)
