"""A ladder: checkpoints of one training that try the same goals, so that success is seen against training step."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from api_schemas.job import MAX_SEED, MAX_TRIALS, JobPriority, JobState, PolicyDigest, PolicyTask, TaskName
from api_schemas.physics import ObjectName, ObjectScale
from api_schemas.schema import Schema

MAX_RUNGS = 100
MAX_STEP = 1e15
MAX_LADDER_TRIALS = 10_000
"""Of all rungs together; they are queued in one transaction, which others wait for."""


class RungRequest(Schema):
    """One checkpoint; ``step`` is its training step, or whatever number the checkpoints differ by."""

    policy: PolicyDigest
    step: float = Field(ge=-MAX_STEP, le=MAX_STEP)


class LadderRequest(Schema):
    """Body of POST /v1/ladders: one job for each rung, all with the same seed. Without a seed the server draws one."""

    name: str = Field(min_length=1, max_length=100)
    task: PolicyTask
    rungs: Annotated[tuple[RungRequest, ...], Field(min_length=1, max_length=MAX_RUNGS)]
    trials: int = Field(default=40, ge=1, le=MAX_TRIALS, description="of each rung")
    seed: int | None = Field(default=None, ge=0, le=MAX_SEED)
    object: ObjectName = ObjectName.CUBE
    object_scale: ObjectScale = 1.0
    priority: JobPriority = JobPriority.NORMAL

    @model_validator(mode="after")
    def _not_too_many_trials(self) -> Self:
        asked = self.trials * len(self.rungs)
        if asked > MAX_LADDER_TRIALS:
            raise ValueError(f"{asked} trials of all rungs together are more than {MAX_LADDER_TRIALS}; ask for fewer of each")
        return self


class Rung(Schema):
    """One rung as the API shows it; rate and interval (Wilson's, 80 %) are of the trials done so far, null before the first."""

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


class Ladder(Schema):
    """A ladder as the API shows it, its rungs by step."""

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
