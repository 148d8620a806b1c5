"""Why a trial failed, as replays without some of its robot's effects tell it; operators see effects and values, users groups."""

from collections import Counter
from collections.abc import Mapping, Sequence
from enum import StrEnum

from pydantic import Field

from api_schemas.schema import Schema
from api_schemas.success_rate import wilson

TRAINING: dict[str, str] = {
    "joint_friction": "the friction of each joint",
    "late_commands": "the delay of actions",
    "motors": "the torque of each motor",
    "links": "masses, play and stiffness of the fingers",
    "table": "the tilt of the table",
    "object": "friction, mass and size of the object",
    "encoders": "offsets and noise of the encoders",
    "images": "light, paint and noise of the images",
    "late_camera": "the camera's delay",
    "blind_camera": "lost frames of the camera",
    "off_camera": "offset and noise of the seen pose",
}
"""What training against a group varies, by the group's name; nothing helps against a fault."""


MOST_NAMED = 3
"""Groups that a user is told for one trial."""


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
    """A group of effects: whether the trial succeeds without it, and in so many of so many replays with other noise.

    Users are told no counts: they are null.
    """

    name: str
    words: str
    explains: bool
    turned: bool
    successes: int | None = None
    replays: int | None = None


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
    who may not know the robot's physics; they are told no counts either, and of groups only those that explain the failure.
    """

    trial: str
    verdict: WhyVerdict
    groups: tuple[WhyGroup, ...]
    control_successes: int | None = None
    control_replays: int | None = None
    effects: tuple[WhyEffect, ...] | None = None
    replays: int | None = None

    @property
    def blamed(self) -> tuple[WhyGroup, ...]:
        """The groups that explain the failure."""
        return tuple(group for group in self.groups if group.explains)

    def for_users(self) -> "Why":
        """Only what users may know: the verdict, and by their names the first groups that explain it."""
        named = [group.model_copy(update={"successes": None, "replays": None}) for group in self.blamed[:MOST_NAMED]]
        return Why(trial=self.trial, verdict=self.verdict, groups=tuple(named))

    @property
    def sentence(self) -> str:
        """The answer in one line."""
        match self.verdict:
            case WhyVerdict.CAUSE:
                return f"it succeeds without {', or without '.join(_told(group) for group in self.blamed)}{self._control}"
            case WhyVerdict.CHANCE:
                return f"it is chance: with other noise alone it often succeeds{self._control}"
            case WhyVerdict.TOGETHER:
                return "it is several effects together: it succeeds on an ideal robot, and no single group explains it"
            case WhyVerdict.POLICY:
                return "it is the policy: the trial fails on an ideal robot, too"

    @property
    def _control(self) -> str:
        if self.control_replays is None:
            return ""
        return f"; {self.control_successes} of {self.control_replays} replays with other noise alone succeed"


def _told(group: WhyGroup) -> str:
    return group.words if group.replays is None else f"{group.words} ({group.successes} of {group.replays} replays)"


class TrialWhy(Schema):
    """The state of an answer about a trial; ``why`` is there once it is done, ``problem`` where it cannot be had."""

    trial: str
    state: WhyState
    sentence: str | None = None
    why: Why | None = None
    problem: str | None = None
    questions_left: int | None = Field(default=None, description="of this robot; null for operators, who ask as they like")


class GroupShare(Schema):
    """How many of the explained failures a group explains, with the 80 % interval of the share."""

    name: str
    words: str
    trials: int
    share: float
    interval_80: tuple[float, float]


class JobWhy(Schema):
    """Why a job's trials failed: so many answered, how often each verdict, groups, and what training could help."""

    job_id: str
    failed: int
    answered: int
    verdicts: dict[WhyVerdict, int]
    groups: tuple[GroupShare, ...]
    advice: str
    trials: tuple[TrialWhy, ...]


def job_why(job_id: str, failed: int, trials: Sequence[TrialWhy], training: Mapping[str, str] = TRAINING) -> JobWhy:
    """The table of a job.

    Args:
        job_id: its id.
        failed: how many of its trials missed their goals.
        trials: those that were asked about.
        training: what training against a group varies, by the group's name.
    """
    answers = [trial.why for trial in trials if trial.why is not None]
    words = {group.name: group.words for answer in answers for group in answer.blamed}
    counts = Counter(group.name for answer in answers for group in answer.blamed)
    shares = tuple(
        GroupShare(
            name=name,
            words=words[name],
            trials=count,
            share=count / len(answers),
            interval_80=wilson(count, len(answers), 0.8),
        )
        for name, count in counts.most_common()
    )
    verdicts = Counter(answer.verdict for answer in answers)
    return JobWhy(
        job_id=job_id,
        failed=failed,
        answered=len(answers),
        verdicts={verdict: verdicts[verdict] for verdict in WhyVerdict},
        groups=shares,
        advice=_advice(verdicts, shares, training),
        trials=tuple(trials),
    )


def _advice(verdicts: Counter[WhyVerdict], shares: tuple[GroupShare, ...], training: Mapping[str, str]) -> str:
    if not sum(verdicts.values()):
        return "nothing is known yet"
    if verdicts[WhyVerdict.POLICY] * 2 > sum(verdicts.values()):
        return "most of these trials fail on an ideal robot, too: train longer, or another policy, before you randomise more"
    varied = [training[share.name] for share in shares[:2] if training.get(share.name)]
    if varied:
        return f"randomise {' and '.join(varied)} more in training"
    if verdicts[WhyVerdict.CHANCE] * 2 > sum(verdicts.values()):
        return "most of these trials fail by chance: train with more noise, or until the margin at the goal is larger"
    return "no single group explains enough: randomise all effects together in training"
