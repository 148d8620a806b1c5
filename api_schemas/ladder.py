"""A ladder: checkpoints of one training that try the same goals, so that success is seen against training step."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from api_schemas.correlation import Correlation
from api_schemas.job import MAX_CHOSEN, MAX_SEED, JobPriority, JobState, PolicyDigest, PolicyTask, TaskName
from api_schemas.physics import ObjectName, ObjectScale
from api_schemas.schema import Schema

MAX_RUNGS = 100
MAX_STEP = 1e15
MAX_LADDER_TRIALS = 10_000
"""Of all rungs together; they are queued in one transaction, which others wait for."""


class LadderEnds(StrEnum):
    """By which rule rungs are given up before all goals were tried.

    ``known``: when another one is known to be better, at 5 % for any false one; it ends when the best is known.
    ``halving``: the worse half at each stage (successive halving), whatever the difference.
    """

    KNOWN = "known"
    HALVING = "halving"


class RungRequest(Schema):
    """One checkpoint; ``step`` is its training step, or whatever number the checkpoints differ by."""

    policy: PolicyDigest
    step: float = Field(ge=-MAX_STEP, le=MAX_STEP)
    training_reward: float | None = Field(default=None, ge=-MAX_STEP, le=MAX_STEP, description="what the training said of it")


class LadderRequest(Schema):
    """Body of POST /v1/ladders: one job for each rung, all with the same seed. Without a seed the server draws one."""

    name: str = Field(min_length=1, max_length=100)
    task: PolicyTask
    rungs: Annotated[tuple[RungRequest, ...], Field(min_length=1, max_length=MAX_RUNGS)]
    trials: int = Field(default=40, ge=1, le=MAX_CHOSEN, description="of each rung")
    seed: int | None = Field(default=None, ge=0, le=MAX_SEED)
    object: ObjectName = ObjectName.CUBE
    object_scale: ObjectScale = 1.0
    priority: JobPriority = JobPriority.NORMAL
    ends: LadderEnds | None = Field(default=None, description="by which rule rungs are given up; ``trials`` is the most then")

    @model_validator(mode="after")
    def _not_too_many_trials(self) -> Self:
        asked = self.trials * len(self.rungs)
        if asked > MAX_LADDER_TRIALS:
            raise ValueError(f"{asked} trials of all rungs together are more than {MAX_LADDER_TRIALS}; ask for fewer of each")
        return self


class Rung(Schema):
    """One rung as the API shows it; rate and intervals are of the trials that count so far, null before the first.

    Intervals are Wilson's, and confidence sequences where the ladder may give rungs up.
    """

    step: float
    job_id: str
    state: JobState
    policy: str
    policy_name: str
    trials: int
    trials_done: int
    successes: int
    success_rate: float | None
    interval_80: tuple[float, float] | None
    interval_95: tuple[float, float] | None
    training_reward: float | None = None
    given_up: bool = Field(default=False, description="before all goals were tried, since others are better")
    letters: str | None = Field(default=None, description="rungs that share one cannot be told apart")


class Ladder(Schema):
    """A ladder as the API shows it, its rungs by step.

    ``best`` is the job of the rung with the highest lower bound; letters say which others cannot be told from it. They
    come of the goals that two rungs have both tried, on the same physics, with the chance of any false pair kept to 5 %.
    """

    ladder_id: str
    name: str
    owner: str
    created_at: str
    task: TaskName
    object: ObjectName
    object_scale: float
    trials: int
    seed: int
    seed_drawn_by_server: bool
    rungs: tuple[Rung, ...]
    ends: LadderEnds | None = None
    best: str | None = None
    correlations: tuple[Correlation, ...] = Field(
        default=(), description="of the rungs' success rates with step and training reward, where they can be told"
    )

    @property
    def is_over(self) -> bool:
        """Whether no rung changes any more."""
        return all(rung.state not in {JobState.QUEUED, JobState.RUNNING} for rung in self.rungs)


class LadderLine(Schema):
    """A ladder in a list."""

    ladder_id: str
    name: str
    owner: str
    created_at: str
    task: TaskName
    rungs: int
    trials: int
    trials_done: int


class LadderPage(Schema):
    """One page of ladders, newest first; ``next_cursor`` is null on the last page."""

    ladders: tuple[LadderLine, ...]
    next_cursor: str | None = None
