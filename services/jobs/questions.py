"""Questions that jobs are run for: their rows, and how they stand, read from the trials of the jobs."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from sqlalchemy import insert, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import FINAL_JOB_STATES
from api_schemas.question import (
    Pair,
    Question,
    QuestionRequest,
    Verdict,
    judge_pairs,
    judge_rate,
    pair_question,
    rate_question,
)
from api_schemas.trial import OutcomeKind, TrialState
from services.database.rows import AnyRow
from services.database.tables import job, question, trial
from services.jobs.power import findable


@dataclass(frozen=True)
class Ended:
    """A trial that is done: whether it succeeded, and on which robot."""

    succeeded: bool
    robot: str


@dataclass(frozen=True)
class Standing:
    """A question as it stands: its row, the rows of its jobs, and the trials of both that count, goal by goal.

    ``counted`` are those up to the goal that answered it, all so far while it is open. ``ready`` counts the first goals that
    both have tried, and ``most`` those that can be tried at all.
    """

    row: AnyRow
    job: AnyRow
    other: AnyRow | None
    most: int
    ready: int
    counted: int
    verdict: Verdict | None
    this_ended: Sequence[Ended]
    other_ended: Sequence[Ended]

    @property
    def is_of_one_physics(self) -> bool:
        """Whether both jobs were done with the same physics throughout."""
        if self.other is None or self.counted == 0:
            return True
        mixed = self.job.physics_mixed or self.other.physics_mixed
        return not mixed and self.job.physics == self.other.physics

    @property
    def shown(self) -> Question:
        """As the API and reports show it."""
        asked = Question(
            job_id=self.job.job_id,
            policy_name=self.job.policy_name,
            against_job=None if self.other is None else self.other.job_id,
            against_policy_name=None if self.other is None else self.other.policy_name,
            bar=self.row.bar,
            at_least=self.row.at_least,
            findable=self.row.findable,
            most_goals=self.most,
            goals=0,
            successes=0,
            estimate=None,
            sequence_80=(0.0, 1.0),
            sequence_95=(0.0, 1.0),
            sentence="",
        )
        this, other = self.this_ended[: self.counted], self.other_ended[: self.counted]
        if self.other is None:
            return rate_question(asked, [each.succeeded for each in this], self.verdict)
        same = sum(one.robot == another.robot for one, another in zip(this, other, strict=True))
        shown = pair_question(asked, _pairs(this, other), self.verdict, same)
        if self.is_of_one_physics:
            return shown
        return shown.model_copy(update={"sentence": f"the robots' physics changed between the jobs; {shown.sentence}"})


async def ask(tx: AsyncConnection, number: int, asked: QuestionRequest, goals: int, other: int | None, *, is_twin: bool) -> None:
    """Keeps the question of a job against the job of another number, or against a bar."""
    values: dict[str, Any] = {"bar": asked.bar, "at_least": asked.at_least, "findable": findable(asked, goals)}
    await tx.execute(insert(question).values(job_number=number, against_number=other, is_twin=is_twin, **values))


_THIS, _OTHER = job.alias("this"), job.alias("other")
_OPEN = (
    select(question.c.job_number, _THIS.c.last_event, _OTHER.c.last_event.label("other_event"))
    .join(_THIS, _THIS.c.number == question.c.job_number)
    .outerjoin(_OTHER, _OTHER.c.number == question.c.against_number)
    .where(question.c.verdict.is_(None))
    .order_by(question.c.job_number)
)


async def open_ones(connection: AsyncConnection) -> Sequence[AnyRow]:
    """The numbers of jobs whose questions are open, with the last events of both jobs."""
    return (await connection.execute(_OPEN)).all()


async def of_job(connection: AsyncConnection, row: AnyRow) -> Question | None:
    """The question that ends a job, its own or that of the job that it was queued for; None of all others."""
    if not row.judged:
        return None
    of_either = or_(question.c.job_number == row.number, question.c.against_number == row.number)
    found = (await connection.execute(select(question).where(of_either, _is_about(row.number)))).first()
    return None if found is None else (await standing(connection, found)).shown


def _is_about(number: int) -> Any:
    return or_(question.c.job_number == number, question.c.is_twin.is_(True))


async def standing(connection: AsyncConnection, row: AnyRow) -> Standing:
    """How a question stands by the trials that are done."""
    this = await _job(connection, row.job_number)
    other = None if row.against_number is None else await _job(connection, row.against_number)
    of_this = await _ended(connection, this.number)
    of_other = [] if other is None else await _ended(connection, other.number)
    most = this.trials
    if other is not None and other.state in FINAL_JOB_STATES and (not row.is_twin or row.verdict is None):
        most = min(most, len(of_other))
    if other is None:
        ready = len(of_this)
        counted, verdict = judge_rate([each.succeeded for each in of_this], most, row.bar)
    else:
        ready = min(len(of_this), len(of_other))
        counted, verdict = judge_pairs(_pairs(of_this[:ready], of_other[:ready]), this.trials, row.at_least)
        if verdict is None and ready >= most:  # the other job has ended early: what was tried counts
            counted, verdict = ready, Verdict.UNDECIDED
    if row.verdict is not None:
        verdict = Verdict(row.verdict)
        counted = counted if this.counted_trials is None else this.counted_trials
    return Standing(row, this, other, most, ready, counted, verdict, of_this, of_other)


def _pairs(this: Sequence[Ended], other: Sequence[Ended]) -> list[Pair]:
    return [(before.succeeded, now.succeeded) for now, before in zip(this, other, strict=True)]


async def _job(connection: AsyncConnection, number: int) -> AnyRow:
    return (await connection.execute(select(job).where(job.c.number == number))).one()


async def _ended(connection: AsyncConnection, number: int) -> list[Ended]:
    """The first trials of a job that are all done, up to one that is not.

    Trials after it do not count yet: which of them end first may depend on how they end.
    """
    wanted = select(trial.c.state, trial.c.outcome, trial.c.robot).where(trial.c.job_number == number).order_by(trial.c.ordinal)
    rows = (await connection.execute(wanted)).all()
    first = takewhile(lambda row: row.state == TrialState.DONE, rows)
    return [Ended(json.loads(row.outcome)["kind"] == OutcomeKind.SUCCEEDED, row.robot) for row in first]
