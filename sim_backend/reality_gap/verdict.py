"""What a study says in the end, as plain values that become JSON."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

AXES = ("x", "y", "z")
"""Places of an effect's numbers that are one place together."""


class VerdictKind(StrEnum):
    """How a study ended."""

    NAMED = "named"
    CONFUSABLE = "confusable"
    UNEXPLAINED = "unexplained"
    NOTHING_WRONG = "nothing_wrong"
    NOT_IDENTIFIABLE = "not_identifiable"
    CALIBRATED = "calibrated"
    """Numbers were fitted all at once, which names nothing."""


@dataclass(frozen=True)
class Cause:
    """One number of one effect at one place: ``where`` is a joint's name, ``all joints``, ``table``, an object or ``camera``."""

    effect: str
    parameter: str
    where: str
    value: float
    unit: str
    interval_90: tuple[float, float]


@dataclass(frozen=True)
class Doubt:
    """A cause that may as well be something that is no fault: what that is, in words, and what would tell."""

    cause: Cause
    other: str
    told_by: str


@dataclass(frozen=True)
class Rival:
    """A hypothesis that lost: how far it lies behind (nats) and what separates it."""

    effect: str
    where: str
    behind: float
    separated_by: str


class Told(StrEnum):
    """What a study says of one effect of the catalogue."""

    NAMED = "named"
    CONFUSABLE = "confusable"
    EXCLUDED = "excluded"
    NOT_JUDGED = "not_judged"


@dataclass(frozen=True)
class EffectJudged:
    """One effect of the catalogue, and what these data say of it.

    Attributes:
        effect: its name.
        told: that it is there, that it may be, that it is not, or that nobody asked.
        above: of an excluded one, the size of its first number that would have been seen at every joint; None otherwise.
        unit: of that.
        because: in words, why it is confusable or not judged.
    """

    effect: str
    told: Told
    above: float | None = None
    unit: str = ""
    because: str = ""


@dataclass(frozen=True)
class HeldOut:
    """Error on episodes or stretches that were not used to fit. ``reduction`` is a share of ``before``.

    ``is_unseen`` is false where none was held out, as in windows that are simulated: then it is the error of what was fitted.
    """

    metric: str
    unit: str
    before: float
    after: float
    noise_floor: float
    reduction: float
    reduction_interval_95: tuple[float, float]
    samples: int
    is_unseen: bool = True


@dataclass(frozen=True)
class Verdict:
    """What is wrong with the model, or that nothing is, or why nobody can tell.

    ``causes`` holds the named ones, or the members of a confusable set. ``extended`` are values of the extended model where it
    has others than the causes: more, what makes it go where the robot went without being told to be a cause, or where many causes
    are unsure the likeliest ones. ``null_p`` is the share of healthy sessions whose largest gain is at least this one's, none
    where all causes were seen without a fit or several of a cube were fitted together. ``held_out_there`` are errors where such
    causes act, which ``held_out`` leaves out. ``rejected`` are the best other explanations of the named causes, closest first,
    with what speaks against each; ``runner_up`` is the first of them. ``misreads`` is what the data agree
    with if something in them is not as it is told. ``effects`` says of every effect of the catalogue what came of it, where a
    subject answers for all of them.
    """

    verdict: VerdictKind
    summary: str
    causes: tuple[Cause, ...] = ()
    extended: tuple[Cause, ...] = ()
    held_out: HeldOut | None = None
    held_out_there: tuple[HeldOut, ...] = ()
    null_p: float | None = None
    runner_up: Rival | None = None
    rejected: tuple[Rival, ...] = ()
    follows: tuple[str, ...] = ()
    cannot_tell: tuple[str, ...] = ()
    record_next: tuple[str, ...] = ()
    misreads: str = ""
    effects: tuple[EffectJudged, ...] = ()

    def document(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


_ORDER = (
    VerdictKind.CALIBRATED,
    VerdictKind.UNEXPLAINED,
    VerdictKind.CONFUSABLE,
    VerdictKind.NAMED,
    VerdictKind.NOTHING_WRONG,
    VerdictKind.NOT_IDENTIFIABLE,
)


def joined(verdicts: Sequence[Verdict]) -> Verdict:
    """One verdict of several: the one that asks for most attention, with everybody's causes."""
    return replace(
        min(verdicts, key=lambda verdict: _ORDER.index(verdict.verdict)),
        summary=" ".join(verdict.summary for verdict in verdicts),
        causes=tuple(cause for verdict in verdicts for cause in verdict.causes),
        extended=tuple(cause for verdict in verdicts for cause in verdict.extended or verdict.causes)
        if any(verdict.extended for verdict in verdicts)
        else (),
        rejected=tuple(rival for verdict in verdicts for rival in verdict.rejected),
        held_out=next((v.held_out for v in verdicts if v.held_out is not None), None),
        held_out_there=tuple(x for v in verdicts for x in v.held_out_there),
        follows=tuple(x for v in verdicts for x in v.follows),
        cannot_tell=tuple(x for v in verdicts for x in v.cannot_tell),
        record_next=tuple(x for v in verdicts for x in v.record_next),
        misreads=" ".join(v.misreads for v in verdicts if v.misreads),
        effects=tuple(x for v in verdicts for x in v.effects),
    )


def names_of(causes: Sequence[Cause]) -> frozenset[tuple[str, str]]:
    """Effect and place of each, without numbers."""
    return frozenset((cause.effect, cause.where) for cause in causes)
