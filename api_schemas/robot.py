"""Robots as the API shows them, and the messages between a robot and the API."""

from enum import StrEnum

from pydantic import Field

from api_schemas.job import TaskName
from api_schemas.policy import PolicyManifest
from api_schemas.schema import Schema
from api_schemas.trial import Outcome

LEASE_S = 15.0
"""How long a lease lives without renewal."""
RENEW_EVERY_S = 3.0
"""How often a robot renews its lease."""


class RobotState(StrEnum):
    """What a robot is doing."""

    IDLE = "idle"
    LEASED = "leased"
    RUNNING = "running"
    DRAINING = "draining"
    OUT_OF_SERVICE = "out_of_service"
    LOST = "lost"


class Robot(Schema):
    """A robot as the API shows it."""

    robot: str
    state: RobotState
    pid: int | None
    host: str | None
    trial: str | None
    reason: str | None
    job: str | None = None
    simulated_s: float | None = None  # of the running trial
    last_seen_at: str | None = None
    trials_done: int = 0


class RobotPage(Schema):
    """All robots, by name."""

    robots: tuple[Robot, ...]


class Lease(Schema):
    """The right of one trial to one robot, as offered over the bus."""

    trial_id: str
    job_id: str
    ordinal: int
    fence: int = Field(ge=1)
    robot: str
    policy: str
    manifest: PolicyManifest
    graph_sha256: str
    task: TaskName
    seed: int
    lease_s: float = LEASE_S


class OfferReply(Schema):
    """A robot's answer to an offered lease."""

    accepted: bool
    reason: str | None = None


class Renewal(Schema):
    """Body of POST /v1/leases/{trial_id}/renew."""

    robot: str
    fence: int


class RenewalReply(Schema):
    """The lease goes on for ``lease_s`` seconds; with ``cancel`` the robot stops and sends a ``cancelled`` outcome."""

    lease_s: float
    cancel: bool


class OutcomeReport(Schema):
    """Body of POST /v1/leases/{trial_id}/outcome; the log was uploaded before, under the same fence."""

    robot: str
    fence: int
    outcome: Outcome
    log_sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
