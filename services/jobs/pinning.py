"""Jobs whose trials all belong on one robot: the first lease draws it, and it is free again if nothing came of that."""

import json

from sqlalchemy import bindparam, update
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import TrialState
from services.database.tables import job, trial

_DRAW = (
    update(job)
    .where(job.c.number == bindparam("of_job"), job.c.any_robot.is_(True), job.c.robot.is_(None))
    .values(robot=bindparam("to_robot"))
)
_GIVE_UP = (
    update(job)
    .where(
        job.c.number == bindparam("of_job"),
        job.c.any_robot.is_(True),
        job.c.robot.is_not(None),
        job.c.trials_done == 0,
        job.c.trials_active == 0,
    )
    .values(robot=None)
)
_POINT = (
    update(trial)
    .where(trial.c.job_number == bindparam("of_job"), trial.c.state.in_((TrialState.QUEUED, TrialState.LEASED)))
    .values(robot_order=bindparam("to_order"), first_choice=bindparam("to_choice"), departure=None, passed_over_s=None)
)


async def pin(tx: AsyncConnection, job_number: int, robot: str) -> None:
    """The robot has got a trial of the job; where any robot will do, it gets all others too."""
    if (await tx.execute(_DRAW, {"of_job": job_number, "to_robot": robot})).rowcount:
        await tx.execute(_POINT, {"of_job": job_number, "to_order": json.dumps([robot]), "to_choice": robot})


async def unpin(tx: AsyncConnection, job_number: int) -> None:
    """The robot gave a trial back; where any robot will do and this one has nothing of the job, another may take it."""
    if (await tx.execute(_GIVE_UP, {"of_job": job_number})).rowcount:
        await tx.execute(_POINT, {"of_job": job_number, "to_order": "[]", "to_choice": None})
