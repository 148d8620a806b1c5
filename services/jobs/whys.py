"""Questions about why trials failed: who may ask how often, what is answered, and which is to be computed next.

An answer is kept with its trial and never computed twice. Each question of a user counts against their budget for the robot that
ran the trial: what many answers tell of one robot is bounded by how many there can be.
"""

import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import OutcomeKind
from api_schemas.why import TrialWhy, Why, WhyState
from services.database.rows import AnyRow
from services.database.tables import job, policy, trial, why
from services.errors import Conflict, NotFound, TooMany
from services.policies import owners

MOST_OPEN = 50
"""Questions of one owner that wait for their answers."""
MOST_TRIES = 2
"""An answer that took its process with it twice is not tried again."""
RETRY_AFTER_S = 10
NEVER_AGAIN_S = 30 * 24 * 3600
"""What a refusal for good says of when to ask again: it never helps."""


@dataclass(frozen=True)
class Budget:
    """Questions that a user has for each robot; operators have no limit."""

    per_robot: int


async def ask(tx: AsyncConnection, row: AnyRow, budget: Budget, now_s: float, *, as_operator: bool) -> None:
    """Notes the question about a trial, unless it was asked before.

    Args:
        tx: a transaction.
        row: the trial's.
        budget: of its owner.
        now_s: the time.
        as_operator: whether one asks who may know all robots; that counts against nobody's budget.

    Raises:
        Conflict: the trial did not fail, or its truth is gone.
        TooMany: the budget for its robot is used up, or too many questions wait.
    """
    await owners.hold(tx, row.owner)
    known = (await tx.execute(select(why).where(why.c.trial_id == row.trial_id))).one_or_none()
    if known is not None and (as_operator or known.counted):
        return
    _check_failed(row)
    if not as_operator:
        await _check_budget(tx, row, budget)
    if known is not None:
        await tx.execute(update(why).where(why.c.trial_id == row.trial_id).values(counted=True))
        return
    values = {"trial_id": row.trial_id, "owner": row.owner, "robot": row.robot, "counted": not as_operator}
    await tx.execute(insert(why).values(**values, state=WhyState.QUEUED, asked_s=now_s, due_s=now_s, tries=0))


def _check_failed(row: AnyRow) -> None:
    kind = None if row.outcome is None else json.loads(row.outcome).get("kind")
    if kind != OutcomeKind.FAILED:
        what = f"is {row.state}" if kind is None else f"ended as {kind}"
        raise Conflict("nothing-to-explain", f"Trial {row.trial_id} {what}; only trials that missed their goal are explained.")
    if row.truth_sha256 is None or row.log_sha256 is None:
        detail = (
            f"Trial {row.trial_id} has no truth apart from its log: it ran on an ideal robot, so that it was the policy, or its "
            "files were removed. Ask about another trial."
        )
        raise Conflict("truth-gone", detail)


async def _check_budget(tx: AsyncConnection, row: AnyRow, budget: Budget) -> None:
    asked = await _asked(tx, row.owner, row.robot)
    if asked >= budget.per_robot:
        detail = (
            f"{row.owner} has asked why {asked} trials of {row.robot} failed and may ask {budget.per_robot} times: more answers "
            "could tell the robot's hidden physics. Answers that are there can be read again; ask about trials of other robots, "
            "or ask the farm's operator."
        )
        raise TooMany("why-budget-used", detail, NEVER_AGAIN_S, robot=row.robot, asked=asked, limit=budget.per_robot)
    waiting = select(func.count()).select_from(why).where(why.c.owner == row.owner, why.c.state.in_(_OPEN))
    count = (await tx.execute(waiting)).scalar_one()
    if count >= MOST_OPEN:
        detail = f"{count} questions of {row.owner} wait for their answers, and {MOST_OPEN} may; wait for some of them."
        raise TooMany("open-whys-quota", detail, RETRY_AFTER_S, open_questions=count, limit=MOST_OPEN)


_OPEN = (WhyState.QUEUED, WhyState.RUNNING)


async def _asked(connection: AsyncConnection, owner: str, robot: str) -> int:
    counted = select(func.count()).select_from(why).where(why.c.owner == owner, why.c.robot == robot, why.c.counted)
    return (await connection.execute(counted)).scalar_one()


async def show(connection: AsyncConnection, row: AnyRow, budget: Budget, *, as_operator: bool) -> TrialWhy:
    """The answer about a trial, as far as it is there.

    Raises:
        NotFound: nobody who may know has asked.
    """
    known = (await connection.execute(select(why).where(why.c.trial_id == row.trial_id))).one_or_none()
    if known is None or not (as_operator or known.counted):
        raise NotFound("why-not-asked", f"Nobody has asked why trial {row.trial_id} failed; 'trifarm why {row.trial_id}' asks.")
    found = None if known.answer is None else Why.model_validate_json(known.answer)
    if found is not None and not as_operator:
        found = found.for_users()
    return TrialWhy(
        trial=row.trial_id,
        state=WhyState(known.state),
        sentence=None if found is None else found.sentence,
        why=found,
        problem=known.problem,
        questions_left=None if as_operator else max(0, budget.per_robot - await _asked(connection, row.owner, row.robot)),
    )


async def any_due(connection: AsyncConnection, now_s: float) -> bool:
    """Whether a question is to be computed now."""
    return (await connection.execute(_due(now_s).limit(1))).first() is not None


def _due(now_s: float) -> Select[Any, Any]:
    return select(why.c.trial_id, why.c.tries).where(why.c.due_s <= now_s, why.c.state.in_(_OPEN))


_SERVED = select(why.c.owner, func.max(why.c.due_s).label("until_s")).where(why.c.tries > 0).group_by(why.c.owner).subquery()
"""Until when the last question of each owner is held, or was: all are held as long from when they are taken."""


async def take(tx: AsyncConnection, now_s: float, held_s: float) -> AnyRow | None:
    """The next question of those that are due, which is then held; with its files and the number of this try.

    Owners take turns: it is the oldest of the one whose last question was taken the longest ago.

    Of questions that were held longer than they may, the process is gone: they are due again, and given up after a few tries.
    """
    gone = why.c.due_s <= now_s, why.c.tries >= MOST_TRIES, why.c.state == WhyState.RUNNING
    problem = f"the farm could not compute it: its process ended {MOST_TRIES} times"
    await tx.execute(update(why).where(*gone).values(state=WhyState.FAILED, problem=problem))
    in_turn = _due(now_s).outerjoin(_SERVED, _SERVED.c.owner == why.c.owner)
    in_turn = in_turn.order_by(func.coalesce(_SERVED.c.until_s, 0.0), why.c.asked_s, why.c.trial_id)
    next_one = (await tx.execute(in_turn.limit(1))).one_or_none()
    if next_one is None:
        return None
    held = update(why).where(why.c.trial_id == next_one.trial_id, why.c.tries == next_one.tries, why.c.due_s <= now_s)
    taken = await tx.execute(held.values(state=WhyState.RUNNING, tries=next_one.tries + 1, due_s=now_s + held_s))
    if taken.rowcount != 1:
        return None
    files = (
        select(trial.c.trial_id, trial.c.log_sha256, trial.c.truth_sha256, policy.c.graph_sha256, why.c.tries)
        .join(why, why.c.trial_id == trial.c.trial_id)
        .join(job, job.c.number == trial.c.job_number)
        .join(policy, policy.c.digest == job.c.policy)
        .where(trial.c.trial_id == next_one.trial_id)
    )
    return (await tx.execute(files)).one_or_none()


async def answer(tx: AsyncConnection, trial_id: str, found: Why | None, problem: str | None) -> None:
    """Keeps what came of a question: the answer, or why there is none."""
    done = {"state": WhyState.DONE, "answer": None if found is None else found.model_dump_json()}
    values = {"state": WhyState.FAILED, "problem": problem} if found is None else done
    await tx.execute(update(why).where(why.c.trial_id == trial_id, why.c.state == WhyState.RUNNING).values(**values))
