"""How the farm is: in plain words, and for a health check."""

from collections import Counter
from dataclasses import dataclass

from fastapi import APIRouter

from api_schemas.jail_report import JailReport
from api_schemas.robot import RobotState
from api_schemas.status import FarmStatus
from jail.level import too_open
from services.api.access import AnyCaller
from services.api.farm import Farm, TheFarm
from services.jobs.totals import Work, work_of
from services.jobs.waiting import nobody_in_service, robot_now

router = APIRouter(tags=["farm"])
NAMED = 8
"""Of robots that have the same trouble."""


@dataclass(frozen=True)
class Load:
    """What there is to do and who is there to do it."""

    robots: dict[str, int]
    work: Work


@router.get("/healthz")
async def healthz(farm: TheFarm) -> dict[str, str]:
    """Answers when the API and its database do."""
    await farm.database.check()
    return {"status": "ok", "version": farm.version}


@router.get("/v1/status")
async def status(_caller: AnyCaller, farm: TheFarm) -> FarmStatus:
    """The farm at a glance."""
    load, problems = await load_of(farm), _problems(farm)
    in_service = len(farm.fleet.healthy(farm.clock.now_s()))
    if (reason := too_open(farm.jail, farm.settings.jail_level)) is not None:
        problems = (*problems, f"no policy and no log is taken: {reason}")
    if (shortage := farm.disk.shortage()) is not None:
        problems = (f"nothing new is accepted and no trial is given out: {shortage}; make room there", *problems)
    if load.work.trials_queued and not in_service:
        # It names each robot and what is wrong with it: the same outage is not told again.
        told = {*_silent_robots(farm)}
        problems = (
            f"{load.work.trials_queued} trials wait and {nobody_in_service(farm.fleet, farm.clock.now_s())}",
            *(each for each in problems if each not in told),
        )
    return FarmStatus(
        healthy=not problems,
        summary=f"{in_service} of {len(farm.fleet.members)} robots in service, {load.work.trials_running} trials running, "
        f"{load.work.trials_queued} queued",
        problems=problems,
        robots_by_state=load.robots,
        jobs_by_state=load.work.jobs,
        trials_queued=load.work.trials_queued,
        trials_running=load.work.trials_running,
        oldest_queued_s=load.work.oldest_queued_s,
        version=farm.version,
        farm=farm.settings.farm,
        physics=farm.settings.physics,
        jail=JailReport.of(farm.jail),
        robots_by_jail=_jails(farm),
        services_since=farm.started_at,
    )


async def load_of(farm: Farm) -> Load:
    """What there is to do now."""
    now_s = farm.clock.now_s()
    async with farm.database.read() as connection:
        work = await work_of(connection, now_s)
    robots = Counter(member.state(now_s) for member in farm.fleet.members.values() if not member.has_left)
    return Load({str(state): robots[state] for state in RobotState}, work)


def _problems(farm: Farm) -> tuple[str, ...]:
    return _silent_robots(farm) if farm.fleet.members else ("no robot has joined the farm yet",)


def _silent_robots(farm: Farm) -> tuple[str, ...]:
    now_s = farm.clock.now_s()
    wrong = {RobotState.LOST, RobotState.OUT_OF_SERVICE}
    members = sorted(farm.fleet.members.values(), key=lambda member: member.robot)
    said: dict[str, list[str]] = {}
    for m in members:
        if m.state(now_s) in wrong and not m.has_left:
            said.setdefault(robot_now(m, now_s), []).append(m.robot)
    return tuple(_of_several(names, what) for what, names in said.items())


def _of_several(robots: list[str], what: str) -> str:
    """One sentence for one outage, however many robots it has."""
    if len(robots) == 1:
        return f"{robots[0]} {what}"
    named = ", ".join(robots[:NAMED]) + (f" and {len(robots) - NAMED} more" if len(robots) > NAMED else "")
    return f"{named}: each {what}"


def _jails(farm: Farm) -> dict[str, int]:
    beats = [member.heartbeat for member in farm.fleet.members.values()]
    return dict(Counter(str(beat.jail.level) for beat in beats if beat is not None and beat.jail is not None))
