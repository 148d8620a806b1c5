"""Why a trial failed, as replays without some of its robot's effects tell it; operators see effects and values, users groups."""

from enum import StrEnum

from pydantic import Field

from api_schemas.schema import Schema


class WhyState(StrEnum):
    """Where an answer is: asked for, being computed, there, or impossible."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class WhyVerdict(StrEnum):
    """What was found of a failed trial."""

    CAUSE = "cause"
    CHANCE = "chance"
    TOGETHER = "together"
    POLICY = "policy"


class WhyGroup(Schema):
    """A group of effects: whether the trial succeeds without it, and in so many of so many replays with other noise."""

    name: str
    words: str
    turned: bool
    successes: int
    replays: int
    explains: bool


class WhyEffect(Schema):
    """One effect of a robot by its name in the catalogue, with the values that it has there, as in a physics file."""

    name: str
    turned: bool
    successes: int
    replays: int
    explains: bool
    values: dict[str, float | tuple[float, ...]] = Field(default_factory=dict)


class Why(Schema):
    """What replays of one failed trial found; the likeliest cause first.

    ``control_successes`` of ``control_replays`` succeeded with the robot as it is and other noise. ``effects`` is null for those
    who may not know the robot's physics, and so are groups that explain nothing.
    """

    trial: str
    verdict: WhyVerdict
    control_successes: int
    control_replays: int
    groups: tuple[WhyGroup, ...]
    effects: tuple[WhyEffect, ...] | None = None
    replays: int

    @property
    def blamed(self) -> tuple[WhyGroup, ...]:
        """The groups that explain the failure."""
        return tuple(group for group in self.groups if group.explains)

    def for_users(self) -> "Why":
        """Only what users may know: groups that explain it, and no effect."""
        return self.model_copy(update={"effects": None, "groups": self.blamed})

    @property
    def sentence(self) -> str:
        """The answer in one line."""
        control = f"{self.control_successes} of {self.control_replays} with other noise alone"
        match self.verdict:
            case WhyVerdict.CAUSE:
                told = [
                    f"{group.words} ({group.successes} of {group.replays} replays without it succeed)" for group in self.blamed
                ]
                return f"{'; or '.join(told)}; {control}"
            case WhyVerdict.CHANCE:
                return f"chance: {control} succeed"
            case WhyVerdict.TOGETHER:
                return "several groups together: it succeeds on an ideal robot, and without no single group"
            case WhyVerdict.POLICY:
                return "the policy: it fails on an ideal robot, too"


class TrialWhy(Schema):
    """The state of an answer about a trial; ``why`` is there once it is done, ``problem`` where it cannot be had."""

    trial: str
    state: WhyState
    sentence: str | None = None
    why: Why | None = None
    problem: str | None = None
    questions_left: int | None = None
