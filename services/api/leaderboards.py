"""Routes of the leaderboard: which policy does a task best on this farm."""

from typing import Annotated

from fastapi import APIRouter, Query

from api_schemas.job import PolicyTask
from api_schemas.leaderboard import Contests, Leaderboard
from api_schemas.physics import ObjectName, ObjectScale
from services.api.access import User
from services.api.farm import Farm, TheFarm
from services.jobs import leaderboard
from services.jobs.leaderboard import Wanted
from services.tokens import Caller

router = APIRouter(prefix="/v1/leaderboard", tags=["leaderboard"])
PhysicsNumber = Annotated[int | None, Query(ge=1, le=2**31 - 1)]


@router.get("")
async def list_contests(_caller: User, farm: TheFarm) -> Contests:
    """The tasks and objects that there is a leaderboard of."""
    async with farm.database.read() as connection:
        return Contests(contests=await leaderboard.contests(connection))


@router.get("/{task}")
async def get_leaderboard(
    task: PolicyTask,
    caller: User,
    farm: TheFarm,
    object: ObjectName = ObjectName.CUBE,
    object_scale: Annotated[ObjectScale, Query()] = 1.0,
    physics: PhysicsNumber = None,
) -> Leaderboard:
    """Policies by the lower bound of their 95 % interval, over all trials on one physics (now's if none is named)."""
    return await best(Wanted(task, object, object_scale, physics), caller, farm)


async def best(wanted: Wanted, caller: Caller, farm: Farm) -> Leaderboard:
    """A leaderboard as the caller may see it: others' policies by digest alone."""
    async with farm.database.read() as connection:
        found = await leaderboard.board(connection, wanted, caller.sees_only)
    return Leaderboard(
        farm=farm.settings.farm,
        physics=found.physics,
        task=wanted.task,
        object=wanted.object,
        object_scale=wanted.object_scale,
        policies=found.policies,
        rows=found.rows,
    )
