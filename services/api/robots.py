"""Routes of robots: how they are, and the operator's wish to drain one or to forget it."""

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Depends, Path

from api_schemas.robot import Robot, RobotPage, RobotState
from api_schemas.token import NewToken
from services.api.access import AnyCaller, Bearer, Joining, Operator
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.paging import encode, named
from services.database.pages import Asked, page_of
from services.errors import Conflict, NotFound
from services.jobs import robots, views
from services.jobs.fleet import Member
from services.jobs.lists import owned
from services.tokens import Caller

router = APIRouter(prefix="/v1/robots", tags=["robots"])
Name = Annotated[str, Path(pattern=r"^[a-z0-9-]{1,40}$")]


@router.get("")
async def list_robots(
    caller: AnyCaller, farm: TheFarm, asked: Annotated[Asked, Depends(named(usual=1000, most=1000))]
) -> RobotPage:
    """Robots that ever joined, by name; users see which of their own trials run on them, operators all."""
    page = page_of(list(farm.fleet.members.values()), lambda member: member.robot, asked)
    return RobotPage(robots=await _show(page.entries, caller, farm), next_cursor=encode(page.following))


@router.get("/{robot}")
async def get_robot(robot: Name, caller: AnyCaller, farm: TheFarm) -> Robot:
    """One robot."""
    return await _show_one(robot, caller, farm)


@router.delete("/{robot}", status_code=204, responses=refusals(404, 409))
async def forget_robot(robot: Name, _caller: Operator, farm: TheFarm) -> None:
    """Forgets a robot that is gone for good; what it did stays. Should it come back, it joins as a new one."""
    member = farm.fleet.snapshot(robot)
    if member is not None and (member.present or member.state(farm.clock.now_s()) != RobotState.LOST):
        raise Conflict("robot-present", f"{robot} is there and would join again at once; end its process first.")
    async with farm.database.write() as tx:
        await robots.forget(tx, robot)
    farm.fleet.members.pop(robot, None)
    farm.signals.tell_others(None)


@router.post("/{robot}/token")
async def join_robot(robot: Name, caller: Joining, bearer: Bearer, farm: TheFarm) -> NewToken:
    """The robot's own token, made of the farm's: with it alone it takes part in leases, its own. Always the same one."""
    return await farm.tokens.of_robot(caller, bearer.credentials, robot)


@router.post("/{robot}/drain")
async def drain_robot(robot: Name, caller: Operator, farm: TheFarm) -> Robot:
    """Lets the robot finish its trial and take no other."""
    return await _wish(robot, caller, farm, drain=True)


@router.post("/{robot}/resume")
async def resume_robot(robot: Name, caller: Operator, farm: TheFarm) -> Robot:
    """Takes a drained robot into service again."""
    return await _wish(robot, caller, farm, drain=False)


async def _wish(robot: str, caller: Caller, farm: Farm, *, drain: bool) -> Robot:
    async with farm.database.write() as tx:
        await robots.wish_drain(tx, robot, drain=drain)
    member = farm.fleet.member(robot)
    farm.fleet.wishes += 1
    member.drain, member.test_wanted = drain, not drain
    member.withdrawn = member.withdrawn if drain else None
    farm.signals.tell_others(None)
    farm.signals.wake_dispatcher(urgent=True)
    return await _show_one(robot, caller, farm)


async def _show_one(robot: str, caller: Caller, farm: Farm) -> Robot:
    member = farm.fleet.snapshot(robot)
    if member is None:
        raise NotFound("robot-not-found", f"No robot named {robot} ever joined this farm; GET /v1/robots lists them.")
    (shown,) = await _show([member], caller, farm)
    return shown


async def _show(members: Sequence[Member], caller: Caller, farm: Farm) -> tuple[Robot, ...]:
    now_s = farm.clock.now_s()
    shown = tuple(views.show_robot(member, now_s) for member in members)
    if caller.sees_only is None:
        return shown
    running = {robot.job for robot in shown if robot.job is not None}
    async with farm.database.read() as connection:
        mine = await owned(connection, running, caller.sees_only)
    return tuple(hidden_from_users(robot, is_own=robot.job in mine) for robot in shown)


def hidden_from_users(robot: Robot, *, is_own: bool) -> Robot:
    """A robot without what only operators see: its temperatures, and what it does for another user."""
    health = None if robot.health is None else robot.health.model_copy(update={"motor_temperature_rise_k": None})
    hidden = {} if is_own else {"job": None, "trial": None, "simulated_s": None}
    return robot.model_copy(update={"health": health, **hidden})
