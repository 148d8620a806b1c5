"""The goals of a job's trials: drawn by seeds, taken from another job, or brought by the user."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.excitation import ExcitationName
from api_schemas.job import FINAL_JOB_STATES, MAX_CHOSEN, JobRequest
from api_schemas.trial import TrialState
from services.database.rows import AnyRow
from services.database.tables import job, trial
from services.errors import Conflict, NotFound, Refused
from services.jobs import physics
from services.jobs.order import trial_seed


@dataclass(frozen=True)
class TrialDraw:
    """What a trial begins with, where that is not drawn: seed, order of robots and goal of one's own, the latter two as JSON."""

    excitation: ExcitationName | None = None
    seed: int | None = None
    order: str | None = None
    own_goal: str | None = None

    def seed_of(self, job_seed: int, ordinal: int) -> int:
        """The trial's seed; with a goal of one's own another one for each goal, since jobs are compared by seeds."""
        if self.seed is not None:
            return self.seed
        drawn = trial_seed(job_seed, ordinal)
        if self.own_goal is None:
            return drawn
        digest = hashlib.sha256(f"trifarm-own-goal\n{drawn}\n{self.own_goal}".encode()).digest()
        return int.from_bytes(digest[:8]) >> 1


async def source(tx: AsyncConnection, request: JobRequest, owner: str | None) -> AnyRow:
    """The job whose goals are taken; with ``owner`` only if it is theirs.

    Raises:
        NotFound: there is no such job of theirs.
        Refused: it is of another task or object, or a question is asked against goals in somebody's order.
        Conflict: it has ended without a trial, or was done with other physics than the robots have now.
    """
    row = (await tx.execute(select(job).where(job.c.job_id == request.goals_of))).one_or_none()
    if row is None or owner not in (None, row.owner):
        raise NotFound("job-not-found", f"There is no job {request.goals_of} of yours; GET /v1/jobs lists them.")
    has = (row.task, row.object, row.object_scale)
    if has != (request.task, request.object, request.object_scale):
        wanted = f"task {row.task}, object {row.object}, object_scale {row.object_scale:g}"
        raise Refused("other-task", f"Job {row.job_id} has {wanted}; ask for the same.")
    if request.question is not None and row.own_goals:
        detail = f"Job {row.job_id} has goals of its own in an order of its own; ask against its policy with the same goals."
        raise Refused("own-goals-in-order", detail)
    if request.question is not None:
        await _check_comparable(tx, row)
    return row


async def _check_comparable(tx: AsyncConnection, row: AnyRow) -> None:
    if row.state in FINAL_JOB_STATES and row.trials_done == 0:
        raise Conflict("nothing-to-compare", f"Job {row.job_id} has {row.state} without a trial; compare with another.")
    now = (await tx.execute(select(physics.NOW))).scalar_one_or_none()
    if row.trials_done and (row.physics_mixed or row.physics != now):
        detail = f"Robots have other physics now than job {row.job_id} was done with; ask against its policy instead."
        raise Conflict("other-physics", detail)


async def draws(tx: AsyncConnection, request: JobRequest, of: AnyRow | None) -> Sequence[TrialDraw]:
    """What each trial begins with; of a job, as many as it has, or has tried at its end, if more are asked for.

    Of a large job its first ``MAX_CHOSEN`` are looked at.
    """
    if of is None:
        if request.goals is None:
            return [TrialDraw()] * request.trials
        return [TrialDraw(own_goal=goal.model_dump_json(exclude_defaults=True)) for goal in request.goals]
    columns = (trial.c.seed, trial.c.own_goal, trial.c.robot, trial.c.robot_order, trial.c.state)
    wanted = select(*columns).where(trial.c.job_number == of.number).order_by(trial.c.ordinal)
    rows = (await tx.execute(wanted.limit(MAX_CHOSEN if of.counted_trials is None else of.counted_trials))).all()
    if of.state in FINAL_JOB_STATES:
        rows = _tried(rows, in_order=request.question is not None) or rows
    drawn = [TrialDraw(seed=row.seed, order=_order(row.robot, row.robot_order), own_goal=row.own_goal) for row in rows]
    if of.trials_made is not None and of.state not in FINAL_JOB_STATES:  # of a large job others are yet to come
        drawn += [TrialDraw(seed=trial_seed(of.seed, at)) for at in range(len(rows), min(of.trials, request.trials))]
    return drawn[: request.trials]


def _tried(rows: Sequence[AnyRow], *, in_order: bool) -> Sequence[AnyRow]:
    """Trials that were done; ``in_order`` only those before the first that was not, as questions count goals in order."""
    if in_order:
        return list(takewhile(lambda row: row.state == TrialState.DONE, rows))
    return [row for row in rows if row.state == TrialState.DONE]


def _order(robot: str | None, drawn: str) -> str:
    """The trial's order of robots, with the one that has tried it first."""
    if robot is None:
        return drawn
    return json.dumps([robot, *(each for each in json.loads(drawn) if each != robot)])
