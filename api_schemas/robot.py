"""Robots as the API shows them, and the messages between a robot and the API."""

from enum import StrEnum
from typing import Annotated, Any

from pydantic import ConfigDict, Field, field_serializer, model_validator

from api_schemas.excitation import ExcitationName
from api_schemas.goal import OwnGoal
from api_schemas.job import TaskName
from api_schemas.physics import ObjectName, ObjectScale
from api_schemas.policy import PolicyManifest, first_form
from api_schemas.schema import Schema
from api_schemas.trial import Outcome

LEASE_S = 15.0
"""How long a lease lives without renewal."""
RENEW_EVERY_S = 3.0
"""How often a robot renews its lease."""


MAX_FENCE = 2**31 - 1
Fence = Annotated[int, Field(ge=1, le=MAX_FENCE)]
"""Number of a trial's attempt, as every database can keep it."""


RobotName = Annotated[str, Field(pattern=r"^[a-z0-9-]{1,40}$")]


class RobotState(StrEnum):
    """What a robot is doing."""

    IDLE = "idle"
    LEASED = "leased"
    RUNNING = "running"
    DRAINING = "draining"
    OUT_OF_SERVICE = "out_of_service"
    LOST = "lost"


class SelfTest(Schema):
    """A robot's last test of itself; ``wrong`` says what it found, null when it passed."""

    model_config = ConfigDict(extra="ignore")  # a newer robot may tell more

    at: str
    wrong: str | None


class RobotHealth(Schema):
    """How a robot is, as it says itself; null is what it does not know.

    ``motor_temperature_rise_k`` is that of its hottest motor above ambient, ``tracker_confidence`` that of the
    tracker's last report.
    """

    model_config = ConfigDict(extra="ignore")

    motor_temperature_rise_k: float | None = None
    tracker_confidence: float | None = None
    self_test: SelfTest | None = None


class Robot(Schema):
    """A robot as the API shows it; ``health`` is null where it tells nothing of that, and temperatures are for operators."""

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
    health: RobotHealth | None = None


class RobotPage(Schema):
    """One page of robots, by name; ``next_cursor`` is null on the last page."""

    robots: tuple[Robot, ...]
    next_cursor: str | None = None


class Lease(Schema):
    """The right of one trial to one robot, as offered over the bus.

    A trial is of a policy (``policy``, ``manifest`` and ``graph_sha256`` are there) or of an excitation, never of both.
    """

    trial_id: str
    job_id: str
    ordinal: int
    fence: Fence
    robot: str
    policy: str | None = None
    manifest: PolicyManifest | None = None
    graph_sha256: str | None = None
    excitation: ExcitationName | None = None
    task: TaskName
    seed: int
    object: ObjectName = ObjectName.CUBE
    object_scale: ObjectScale = 1.0
    # Left out where there is none, so that older robots, which do not know it, take all other leases.
    own_goal: OwnGoal | None = Field(default=None, exclude_if=lambda goal: goal is None)
    # Likewise; a robot that does not know it would refuse the lease, and so it should.
    images: bool = Field(default=False, exclude_if=lambda wanted: not wanted)
    lease_s: float = LEASE_S

    @field_serializer("manifest")
    def _known_to_older_robots(self, manifest: PolicyManifest | None) -> dict[str, Any] | None:
        return None if manifest is None else first_form(manifest)

    @model_validator(mode="after")
    def _policy_or_excitation(self) -> "Lease":
        has_policy = [part is not None for part in (self.policy, self.manifest, self.graph_sha256)]
        identifies = self.task is TaskName.IDENTIFY
        if identifies != (self.excitation is not None) or has_policy != [not identifies] * 3:
            raise ValueError(
                f"a lease for {self.task.value} must have {'an excitation and no policy' if identifies else 'a whole policy'}"
            )
        return self


class OfferReply(Schema):
    """A robot's answer to an offered lease."""

    accepted: bool
    reason: str | None = None


class Renewal(Schema):
    """Body of POST /v1/leases/{trial_id}/renew."""

    robot: RobotName
    fence: Fence


class RenewalReply(Schema):
    """The lease goes on for ``lease_s`` seconds; with ``cancel`` the robot stops and sends a ``cancelled`` outcome."""

    lease_s: float
    cancel: bool


class OutcomeReport(Schema):
    """Body of POST /v1/leases/{trial_id}/outcome; truth, if there is any, and log were uploaded before, under the same fence."""

    robot: RobotName
    fence: Fence
    outcome: Outcome
    log_sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
    truth_sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")


class StoredFile(Schema):
    """What became of an uploaded file."""

    model_config = ConfigDict(extra="ignore")  # a newer farm may tell more

    sha256: str
    bytes: int
    new: bool


class OutcomeReply(Schema):
    """The outcome was taken."""

    model_config = ConfigDict(extra="ignore")

    accepted: bool = True
