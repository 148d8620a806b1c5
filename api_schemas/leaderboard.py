"""The leaderboard of a farm: the policies that were tried at a task, by the lower bound of their success rate's interval."""

from typing import Literal

from pydantic import Field

from api_schemas.job import TaskName
from api_schemas.physics import ObjectName
from api_schemas.schema import Schema


class BoardRow(Schema):
    """One policy: all its trials whose seed the server drew, pooled. Name and owner are null for who may not see them.

    Or one recipe of at least two policies of its owner, with ``training_seeds`` and without ``policy``: its rate is the mean of
    the seeds', and its interval one over the seeds. Their trials that were sent under the recipe count here alone.
    """

    rank: int
    policy: str | None
    policy_name: str | None
    owner: str | None
    jobs: int
    trials: int
    successes: int
    success_rate: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]
    intervals: Literal["wilson", "sequence", "seeds"] = Field(
        default="wilson",
        description="a sequence where a question may have ended a job of the policy; of a recipe over its seeds",
    )
    recipe: str | None = None
    training_seeds: int | None = None
    letters: str | None = Field(default=None, description="entries that share one cannot be told apart; null beyond the first")
    last_at: str = Field(description="when the newest of its jobs was queued")


class BoardPhysics(Schema):
    """A physics that robots of this farm have or had.

    Other content under the same name, another farm seed or another form of the scene is another.
    """

    number: int
    name: str
    form: str = Field(description="of the scene")
    since: str = Field(description="when a robot first told that it has it")
    is_now: bool


class Leaderboard(Schema):
    """The policies of one task and object on one physics of this farm, best lower bound first.

    Letters hold at every look, with the chance of any false pair among all entries kept to 5 %.

    ``physics`` is null, and no row there, before any robot told what it has.
    """

    farm: str
    physics: BoardPhysics | None
    task: TaskName
    object: ObjectName
    object_scale: float
    policies: int
    rows: tuple[BoardRow, ...]


class Contest(Schema):
    """A task and an object that policies were tried at on one physics."""

    task: TaskName
    object: ObjectName
    object_scale: float
    physics: BoardPhysics
    policies: int


class Contests(Schema):
    """What this farm has leaderboards of, by task."""

    contests: tuple[Contest, ...]
