"""A question that a job is run for: is this policy better than that one, or as good as a bar? It ends when that is known."""

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, model_validator

from api_schemas.anytime import CHANCE, difference_sequence, is_decided, is_refuted, log_evidence, log_wealth, rate_sequence
from api_schemas.schema import Schema

AGAINST = r"^(j[a-z2-7]{12}|[0-9a-f]{64})$"
MOST_TOLD = 1e12
"""Larger evidence is told as this."""
Share = Annotated[float, Field(gt=0, lt=1)]


class Verdict(StrEnum):
    """What was found out; ``alike`` is that no difference is as large as was asked about."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "alike"
    ABOVE = "above"
    BELOW = "below"
    UNDECIDED = "undecided"


class QuestionRequest(Schema):
    """What a job is to find out: ``against`` a job or the digest of a policy, or whether its rate is above a ``bar``."""

    against: str | None = Field(default=None, pattern=AGAINST, description="a job, or the digest of an uploaded policy")
    bar: Share | None = Field(default=None, description="a success rate")
    at_least: Share | None = Field(default=None, description="the smallest difference from the other policy that matters")

    @model_validator(mode="after")
    def _one_question(self) -> Self:
        if (self.against is None) == (self.bar is None):
            raise ValueError("ask either against a job or policy, or against a bar")
        if self.at_least is not None and self.against is None:
            raise ValueError("at_least is a difference from another policy; a bar needs none")
        return self

    @property
    def names_job(self) -> bool:
        """Whether it is asked against a job."""
        return self.against is not None and self.against.startswith("j")


class Question(Schema):
    """A question and what is known of it after ``goals``, counted in the order of the trials and not of their ends.

    Against another policy ``gained`` counts the goals that only this one reached, ``lost`` those that only the other did, and the
    sequences are of the difference of the rates; against a bar they are of the rate. They hold at every look.
    """

    job_id: str
    policy_name: str
    against_job: str | None = None
    against_policy_name: str | None = None
    bar: float | None = None
    at_least: float | None = None
    findable: str = Field(description="what can be found with this number of goals, told before the start")
    most_goals: int
    goals: int
    successes: int
    other_successes: int | None = None
    gained: int | None = None
    lost: int | None = None
    same_robot: int | None = Field(default=None, description="goals that both tried on the same robot")
    estimate: float | None
    sequence_80: tuple[float, float]
    sequence_95: tuple[float, float]
    evidence: float | None = Field(default=None, description="e-value against equal rates; decided from 20 on")
    verdict: Verdict | None = None
    sentence: str


Pair = tuple[bool, bool]
"""How the other policy's trial and this one's ended on one goal."""


def judge_pairs(pairs: Sequence[Pair], most_goals: int, at_least: float | None) -> tuple[int, Verdict | None]:
    """After how many goals the question is decided, and how; all of them and None while it is open.

    Goals are looked at one after the other, so that the answer does not depend on when somebody looked.
    """
    gained = lost = 0
    for goals, (other, this) in enumerate(pairs, start=1):
        gained, lost = gained + (this and not other), lost + (other and not this)
        if this != other and is_decided(gained, lost):
            return goals, Verdict.BETTER if gained > lost else Verdict.WORSE
        if at_least is not None and _is_alike(gained, lost, goals, at_least):
            return goals, Verdict.ALIKE
        left = most_goals - goals
        may_be_alike = at_least is not None and _is_alike(gained, lost, most_goals, at_least)
        if not (may_be_alike or is_decided(gained + left, lost) or is_decided(gained, lost + left)):
            return goals, Verdict.UNDECIDED
    return len(pairs), Verdict.UNDECIDED if len(pairs) >= most_goals else None


def judge_rate(ended: Sequence[bool], most_goals: int, bar: float) -> tuple[int, Verdict | None]:
    """The same for one policy against a bar."""
    successes = 0
    for goals, succeeded in enumerate(ended, start=1):
        successes += succeeded
        if (verdict := side_of(successes, goals, bar)) is not None:
            return goals, verdict
        left = most_goals - goals
        if side_of(successes + left, most_goals, bar) is None and side_of(successes, most_goals, bar) is None:
            return goals, Verdict.UNDECIDED
    return len(ended), Verdict.UNDECIDED if len(ended) >= most_goals else None


def side_of(successes: int, trials: int, bar: float) -> Verdict | None:
    """The side of the bar that the rate is known to lie on."""
    if not is_refuted(successes, trials, bar, CHANCE):
        return None
    return Verdict.ABOVE if successes > bar * trials else Verdict.BELOW


def _is_alike(gained: int, lost: int, goals: int, at_least: float) -> bool:
    """Whether both differences of this size are refuted, and with them, wealth being convex, all that are larger."""
    most, alike = -math.log(CHANCE), goals - gained - lost
    seen = abs(gained - lost) / goals
    return seen < at_least and all(log_wealth(gained, lost, alike, side * at_least) >= most for side in (1.0, -1.0))


def pair_question(asked: Question, pairs: Sequence[Pair], verdict: Verdict | None, same_robot: int) -> Question:
    """The question as it stands after these goals."""
    goals, gained, lost = len(pairs), pairs.count((False, True)), pairs.count((True, False))
    known = asked.model_copy(
        update={
            "goals": goals,
            "successes": sum(this for _, this in pairs),
            "other_successes": sum(other for other, _ in pairs),
            "gained": gained,
            "lost": lost,
            "same_robot": same_robot,
            "estimate": (gained - lost) / goals if goals else None,
            "sequence_80": difference_sequence(gained, lost, goals, 0.80),
            "sequence_95": difference_sequence(gained, lost, goals, 0.95),
            "evidence": min(math.exp(min(log_evidence(gained, lost), 30.0)), MOST_TOLD),
            "verdict": verdict,
        }
    )
    return known.model_copy(update={"sentence": _pair_sentence(known)})


def rate_question(asked: Question, ended: Sequence[bool], verdict: Verdict | None) -> Question:
    """The same for a question against a bar."""
    goals, successes = len(ended), sum(ended)
    known = asked.model_copy(
        update={
            "goals": goals,
            "successes": successes,
            "estimate": successes / goals if goals else None,
            "sequence_80": rate_sequence(successes, goals, 0.80),
            "sequence_95": rate_sequence(successes, goals, 0.95),
            "verdict": verdict,
        }
    )
    return known.model_copy(update={"sentence": _rate_sentence(known)})


def _pair_sentence(known: Question) -> str:
    low, high = (100 * bound for bound in known.sequence_95)
    so_far = f"{known.gained} gained, {known.lost} lost, difference {low:+.0f} to {high:+.0f} points (95 %, at every look)"
    than, after = f"{known.against_policy_name}", f"after {known.goals} goals"
    match known.verdict:
        case Verdict.BETTER | Verdict.WORSE:
            return f"{known.policy_name} is {known.verdict} than {than}, known {after}: {so_far}"
        case Verdict.ALIKE:
            return f"no difference of {100 * (known.at_least or 0):g} points from {than}, known {after}: {so_far}"
        case Verdict.UNDECIDED:
            return f"not decided within {known.most_goals} goals, stopped {after}: {so_far}"
        case _:
            return f"open {after} of at most {known.most_goals}: {so_far}"


def _rate_sentence(known: Question) -> str:
    low, high = (100 * bound for bound in known.sequence_95)
    bar, after = f"{100 * (known.bar or 0):g} %", f"after {known.goals} trials"
    so_far = f"{known.successes} succeeded, rate {low:.0f} to {high:.0f} % (95 %, at every look)"
    match known.verdict:
        case Verdict.ABOVE | Verdict.BELOW:
            return f"{known.policy_name} is {known.verdict} {bar}, known {after}: {so_far}"
        case Verdict.UNDECIDED:
            return f"not decided within {known.most_goals} trials whether above {bar}, stopped {after}: {so_far}"
        case _:
            return f"open {after} of at most {known.most_goals}: {so_far}"
