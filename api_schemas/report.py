"""The report of a job: outcomes and statistics, written last and never changed."""

from pydantic import Field

from api_schemas.schema import Schema
from api_schemas.trial import Outcome


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


class TimingRow(Schema):
    """Would the policy keep its rate on hardware? Over all trials of the job."""

    p99_ms: float
    max_ms: float
    allowed_ms: float
    missed: int
    actions: int
    keeps_rate: bool


class Report(Schema):
    """What a user came for. Intervals are Wilson's, as fractions."""

    format: str = "trifarm-report/1"
    job_id: str
    task: str
    policy: str
    policy_name: str
    seed: int
    trials: int
    successes: int
    success_rate: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]
    success_ever: int
    mean_success_fraction: float | None
    mean_return: float | None
    policy_faults: int
    platform_faults: int = Field(description="attempts that failed by the platform's fault; never counted in the rate")
    attempts: int
    timing: TimingRow | None
    per_robot: tuple[RobotRow, ...]
    per_trial: tuple[TrialRow, ...]
    platform_fault_attempts: tuple[FaultRow, ...]
    created_at: str
    started_at: str | None
    ended_at: str
    versions: dict[str, str]
