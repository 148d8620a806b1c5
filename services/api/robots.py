"""Routes of robots: how they are, and the operator's wish to drain one."""

from typing import Annotated

from fastapi import APIRouter, Path

from api_schemas.robot import Robot, RobotPage
from services.api.access import AnyCaller, Operator
from services.api.farm import Farm, TheFarm
from services.errors import NotFound
from services.jobs import robots, views

router = APIRouter(prefix="/v1/robots", tags=["robots"])
Name = Annotated[str, Path(pattern=r"^[a-z0-9-]{1,40}$")]


@router.get("")
async def list_robots(_caller: AnyCaller, farm: TheFarm) -> RobotPage:
    """All robots that ever joined, by name."""
    now_s = farm.clock.now_s()
    members = sorted(farm.fleet.members.values(), key=lambda member: member.robot)
    return RobotPage(robots=tuple(views.show_robot(member, now_s) for member in members))


@router.get("/{robot}")
async def get_robot(robot: Name, _caller: AnyCaller, farm: TheFarm) -> Robot:
    """One robot."""
    return _show(robot, farm)


@router.post("/{robot}/drain")
async def drain_robot(robot: Name, _caller: Operator, farm: TheFarm) -> Robot:
    """Lets the robot finish its trial and take no other."""
    return await _wish(robot, farm, drain=True)


@router.post("/{robot}/resume")
async def resume_robot(robot: Name, _caller: Operator, farm: TheFarm) -> Robot:
    """Takes a drained robot into service again."""
    return await _wish(robot, farm, drain=False)


async def _wish(robot: str, farm: Farm, *, drain: bool) -> Robot:
    async with farm.database.write() as tx:
        await robots.wish_drain(tx, robot, drain=drain)
    member = farm.fleet.member(robot)
    member.drain, member.resume_wanted = drain, not drain
    member.withdrawn = member.withdrawn if drain else None
    farm.signals.tell_others(None)
    farm.signals.wake_dispatcher(urgent=True)
    return _show(robot, farm)


def _show(robot: str, farm: Farm) -> Robot:
    member = farm.fleet.snapshot(robot)
    if member is None:
        raise NotFound("robot-not-found", f"No robot named {robot} ever joined this farm; GET /v1/robots lists them.")
    return views.show_robot(member, farm.clock.now_s())
