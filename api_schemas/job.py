"""A job: one policy, one task, n trials; the unit a user queues. An identification has excitations instead of a policy."""

from enum import StrEnum
from typing import Annotated, Any, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from api_schemas.goal import OwnGoal, why_unfit
from api_schemas.physics import ObjectName, ObjectScale
from api_schemas.question import Question, QuestionRequest
from api_schemas.recipe import RecipeName
from api_schemas.schema import Schema

MAX_URL = 500
PORTS = (443, 8443)
"""Those of https; by any other a farm could be had to knock at the doors of other services."""


def _https(url: str) -> str:
    if not (url.isascii() and url.isprintable()) or any(each in url for each in ' \\"<>'):
        raise ValueError("a webhook's address has ASCII characters only, and none of space, backslash, quote and < >")
    parts = urlsplit(url)
    if parts.scheme != "https" or not parts.hostname:
        raise ValueError(f"a webhook's address begins with https:// and a host, this one with {url[:20]!r}")
    if parts.username is not None or parts.password is not None:
        raise ValueError("a webhook's address holds no user and no password; put a secret word into its path")
    if parts.port is not None and parts.port not in PORTS:
        raise ValueError(f"a webhook's port is 443 or 8443, not {parts.port}")
    return url


WebhookUrl = Annotated[str, Field(max_length=MAX_URL), AfterValidator(_https)]


MAX_TRIALS = 100_000
MAX_CHOSEN = 1000
"""Trials of a job whose goals are brought or taken from another job, or that a question may end: they are read at once."""
LONGEST_NAME, LONGEST_NOTE = 100, 2000
MAX_SEED = 2**63 - 1


class TaskName(StrEnum):
    """The tasks of the farm; what they ask stands in ``sim_backend.tasks``, which has the same names (a test)."""

    PUSH = "push"
    LIFT = "lift"
    REACH = "reach"
    FLOOR_POSE = "floor_pose"
    MOVE_CUBE_1 = "move_cube_1"
    MOVE_CUBE_2 = "move_cube_2"
    MOVE_CUBE_3 = "move_cube_3"
    MOVE_CUBE_4 = "move_cube_4"
    IDENTIFY = "identify"  # excitations instead of a policy; asked for with POST /v1/identifications


POLICY_TASKS = tuple(task for task in TaskName if task is not TaskName.IDENTIFY)
"""The tasks that a policy can be asked to do."""


def _for_a_policy(task: TaskName) -> TaskName:
    if task not in POLICY_TASKS:
        choices = ", ".join(POLICY_TASKS)
        raise ValueError(f"{task.value} takes no policy, POST /v1/identifications asks for it; choose from {choices}")
    return task


PolicyTask = Annotated[TaskName, AfterValidator(_for_a_policy)]
JobId = Annotated[str, Field(pattern=r"^j[a-z2-7]{12}$", description="a job")]
PolicyDigest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$", description="digest of an uploaded policy")]


class JobState(StrEnum):
    """``queued -> running -> succeeded | failed | cancelled``; ``succeeded`` means that the job has its report."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class JobPriority(StrEnum):
    """Users take turns within a priority; everybody may ask for ``low``, operators alone for ``high``."""

    HIGH = "high"
    NORMAL = "normal"
    LOW = "low"


FINAL_JOB_STATES = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED})


class JobRequest(Schema):
    """Body of POST /v1/jobs. Without a seed the server draws one."""

    policy: PolicyDigest
    task: PolicyTask
    trials: int = Field(default=40, ge=1, le=MAX_TRIALS)
    seed: int | None = Field(default=None, ge=0, le=MAX_SEED)
    object: ObjectName = ObjectName.CUBE
    object_scale: ObjectScale = 1.0
    priority: JobPriority = JobPriority.NORMAL
    images: bool = Field(default=False, description="whether logs keep what the robot's three cameras saw")
    recipe: RecipeName | None = Field(default=None, description="the training that the policy is one seed of")
    training_seed: int | None = Field(default=None, ge=0, le=MAX_SEED, description="which seed of it")
    name: str | None = Field(default=None, max_length=LONGEST_NAME, description="what its people call it")
    note: str | None = Field(default=None, max_length=LONGEST_NOTE, description="what they want to remember of it")
    webhook: WebhookUrl | None = Field(default=None, description="called at the job's end, where the farm allows webhooks")
    goals: Annotated[tuple[OwnGoal, ...], Field(min_length=1, max_length=MAX_CHOSEN)] | None = Field(
        default=None, description="of one's own, one for each trial"
    )
    like: JobId | None = Field(default=None, description="a job of the same task whose goals and orders of robots are taken")
    question: QuestionRequest | None = Field(
        default=None, description="what ends the job; then ``trials`` is the most that may be tried"
    )

    @model_validator(mode="before")
    @classmethod
    def _as_many_trials_as_goals(cls, asked: Any) -> Any:
        if isinstance(asked, dict) and "trials" not in asked and isinstance(asked.get("goals"), list | tuple):
            return {**asked, "trials": len(asked["goals"])}
        return asked

    @model_validator(mode="after")
    def _seeds_of_a_recipe(self) -> Self:
        if (self.recipe is None) != (self.training_seed is None):
            raise ValueError("a recipe and a training seed go together: which of its trainings is the policy of?")
        return self

    @model_validator(mode="after")
    def _goals_of_one_source(self) -> Self:
        like = self.goals_of
        if self.trials > MAX_CHOSEN and (like is not None or self.question is not None):
            raise ValueError(f"goals of another job, and a question, are for {MAX_CHOSEN} trials at most, not {self.trials}")
        if self.question is not None and self.like is not None:
            raise ValueError("a question against a job takes its goals already; leave like out")
        if like is not None and (self.seed is not None or self.goals is not None):
            raise ValueError(f"the goals are those of job {like}; leave seed and goals out")
        if self.goals is None:
            return self
        if self.trials != len(self.goals):
            raise ValueError(f"{len(self.goals)} goals are for as many trials, not {self.trials}; leave trials out")
        for number, goal in enumerate(self.goals):
            if (unfit := why_unfit(goal, self.task)) is not None:
                raise ValueError(f"goal {number}: {unfit}")
        return self

    @property
    def goals_of(self) -> str | None:
        """The job whose goals are taken, if any."""
        return self.question.against if self.question is not None and self.question.names_job else self.like


class JobLabels(Schema):
    """Body of PATCH /v1/jobs/ID: what is given is set, an empty text or null takes it away."""

    name: str | None = Field(default=None, max_length=LONGEST_NAME)
    note: str | None = Field(default=None, max_length=LONGEST_NOTE)


class JobWebhook(Schema):
    """Body of PUT /v1/jobs/ID/webhook."""

    url: WebhookUrl


class Job(Schema):
    """A job as the API shows it. Counts of trials are by accepted outcome.

    ``policy`` and ``policy_name`` are null for an identification, ``robot`` names the robot that its trials are pinned to.
    While a job is queued, ``queue_position`` counts the trials up to and with its first in the order in which robots take them
    now, and ``estimated_wait_s`` says how long that may last; null when nothing is known to tell it from.
    """

    job_id: str
    state: JobState
    waiting_because: str | None
    policy: str | None
    policy_name: str | None
    task: TaskName
    object: ObjectName = ObjectName.CUBE
    object_scale: float = 1.0
    priority: JobPriority = JobPriority.NORMAL
    robot: str | None = None
    trials: int
    seed: int
    seed_drawn_by_server: bool
    owner: str
    created_at: str
    started_at: str | None
    ended_at: str | None
    trials_done: int
    trials_running: int
    successes: int
    policy_faults: int
    platform_faults: int
    reason: str | None = None
    queue_position: int | None = None
    estimated_wait_s: float | None = None
    own_goals: bool = False
    images: bool = False
    recipe: str | None = None
    training_seed: int | None = None
    name: str | None = None
    note: str | None = None
    question: Question | None = Field(default=None, description="what ends the job, and how it stands; null in lists")


class JobPage(Schema):
    """One page of jobs, newest first; ``next_cursor`` is null on the last page."""

    jobs: tuple[Job, ...]
    next_cursor: str | None = None


class EventKind(StrEnum):
    """What a line of a job's history is about."""

    JOB_QUEUED = "job_queued"
    JOB_RUNNING = "job_running"
    JOB_CANCELLING = "job_cancelling"
    JOB_QUEUED_AGAIN = "job_queued_again"
    JOB_GAVE_UP = "job_gave_up"
    """The end of a job that went on later; readers stop at ``job_ended``."""
    JOB_ENDED = "job_ended"
    TRIAL_LEASED = "trial_leased"
    OFFER_DECLINED = "offer_declined"
    TRIAL_RUNNING = "trial_running"
    TRIAL_DONE = "trial_done"
    TRIAL_CANCELLED = "trial_cancelled"
    ATTEMPT_FAULTED = "attempt_faulted"


class JobEvent(Schema):
    """One line of a job's history, as sent by server-sent events; ``id`` numbers the events and only grows."""

    id: int
    job_id: str
    at: str
    kind: Annotated[EventKind | str, Field(union_mode="left_to_right", description="a newer farm may write others")]
    trial_ordinal: int | None = None
    robot: str | None = None
    text: str
    trials_done: int
    trials: int
    successes: int
    state: JobState
