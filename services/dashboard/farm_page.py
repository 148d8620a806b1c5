"""The page of the farm: is it well, what do its robots do, who waits, and what is wrong now."""

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.responses import RedirectResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.robot import Robot, RobotState
from api_schemas.status import FarmStatus
from api_schemas.token import Scope
from services.api import overview, robots
from services.api.farm import Farm, TheFarm
from services.dashboard import live
from services.dashboard.pages import HEADERS, PageRoute, page, part
from services.dashboard.sessions import Operating, Session, SignedIn
from services.jobs import recent, views
from services.jobs.clock import iso
from services.jobs.lists import owned
from services.jobs.recent import Incident
from services.jobs.totals import UserLoad, load_by_user

router = APIRouter(route_class=PageRoute, include_in_schema=False)
LAST_TRIALS = 50
INCIDENTS_SHOWN = 10
"""Of each robot."""
RATE_MINUTES = 30
KEPT_S = 0.5
"""All who look share what was read within so long."""
HISTORY_KEPT_S = 3.0
NEEDS_ATTENTION = frozenset({RobotState.OUT_OF_SERVICE, RobotState.LOST})
Name = Annotated[str, Path(pattern=r"^[a-z0-9-]{1,40}$")]


@dataclass(frozen=True)
class Seen:
    """The farm as it was a moment ago: nothing that depends on who looks, since all share it."""

    status: FarmStatus
    robots: tuple[Robot, ...]
    loads: list[UserLoad]


@dataclass(frozen=True)
class History:
    """What the robots did lately."""

    recent: dict[str, tuple[int, int]]
    per_minute: list[int]
    given_per_minute: list[int]
    incidents: dict[str, list[Incident]]


@dataclass
class Watcher:
    """Reads the farm for all who look at it; belongs to the event loop."""

    _seen: tuple[float, Seen] | None = None
    _history: tuple[float, History] | None = None
    _lock: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def look(self, session: Session, farm: Farm) -> tuple[Seen, History]:
        """The farm now, or as it was ``KEPT_S`` ago."""
        async with self._lock:
            now_s = farm.clock.now_s()
            if self._history is None or now_s - self._history[0] > HISTORY_KEPT_S:
                async with farm.database.read() as connection:
                    ended = await recent.recently_ended(connection)
                    given = await recent.recently_given(connection, iso(now_s - 60 * RATE_MINUTES))
                    failed = await recent.incidents(connection)
                rates = _per_minute([each.ended_at for each in ended]), _per_minute(given)
                self._history = (now_s, History(recent.by_robot(ended, LAST_TRIALS), *rates, _of_robots(failed)))
            if self._seen is None or now_s - self._seen[0] > KEPT_S:
                async with farm.database.read() as connection:
                    loads = await load_by_user(connection)
                # The status is the same for every caller; of the robots, ``parts`` hides what this viewer may not see.
                self._seen = (now_s, Seen(await overview.status(session.caller, farm), _robots(farm, now_s), loads))
            return self._seen[1], self._history[1]


def _robots(farm: Farm, now_s: float) -> tuple[Robot, ...]:
    members = sorted(farm.fleet.members.values(), key=lambda member: member.robot)
    return tuple(views.show_robot(member, now_s) for member in members)


def _of_robots(failed: Sequence[Incident]) -> dict[str, list[Incident]]:
    """The last incidents of each robot, the newest first."""
    of: dict[str, list[Incident]] = defaultdict(list)
    for each in failed:
        if len(of[each.robot]) < INCIDENTS_SHOWN:
            of[each.robot].append(each)
    return of


def _per_minute(moments: Sequence[str]) -> list[int]:
    """How many of the moments fell into each of the last minutes, the present one last."""
    now, counts = datetime.now(UTC), [0] * RATE_MINUTES
    for moment in moments:
        minutes = int((now - datetime.fromisoformat(moment)).total_seconds() // 60)
        if 0 <= minutes < RATE_MINUTES:
            counts[RATE_MINUTES - 1 - minutes] += 1
    return counts


async def _watcher(request: Request) -> Watcher:
    return request.app.state.dashboard_watcher


TheWatcher = Annotated[Watcher, Depends(_watcher)]


async def parts(session: Session, farm: Farm, watcher: Watcher) -> dict[str, str]:
    """The parts of the page, each robot one."""
    seen, history = await watcher.look(session, farm)
    own, operates = session.caller.owner, session.caller.may(Scope.OPERATE)
    loads = [load for load in seen.loads if operates or load.owner == own]
    made = {
        "health": part("farm/health.html", status=seen.status, robots=len(seen.robots)),
        "queue": part("farm/queue.html", status=seen.status, history=history),
        "users": part("farm/users.html", loads=loads, operates=operates),
    }
    visible = await _visible_jobs(seen.robots, session, farm)
    for robot in sorted(seen.robots, key=lambda each: (each.state not in NEEDS_ATTENTION, each.robot)):
        others = robot.job is not None and robot.job not in visible
        shown = robot if operates else robots.hidden_from_users(robot, is_own=not others)
        context: dict[str, Any] = {"robot": shown, "others": others, "recent": history.recent.get(robot.robot)}
        context |= {"operates": operates, "csrf": session.csrf}
        context["incidents"] = history.incidents.get(robot.robot, []) if operates else []
        made[f"robot-{robot.robot}"] = part("farm/robot.html", **context)
    return made


async def _visible_jobs(listed: tuple[Robot, ...], session: Session, farm: Farm) -> frozenset[str]:
    """Of the jobs that robots work for, those that the viewer may see."""
    running = frozenset(robot.job for robot in listed if robot.job is not None)
    if session.caller.sees_only is None or not running:
        return running
    async with farm.database.read() as connection:
        return await owned(connection, running, session.caller.owner)


@router.get("/")
async def show_farm(session: SignedIn, farm: TheFarm, watcher: TheWatcher) -> Response:
    """The whole page."""
    made = await parts(session, farm, watcher)
    return page("farm.html", session, parts=made, title="Farm", here="farm", live="/live", farm_name=farm.settings.farm)


@router.get("/live", response_class=EventSourceResponse)
async def stream_farm(session: live.Watching, farm: TheFarm, watcher: TheWatcher) -> AsyncIterator[ServerSentEvent]:
    """What changes on the page."""
    async for event in live.stream(farm, session, lambda: parts(session, farm, watcher)):
        yield event


@router.post("/robots/{robot}/drain")
async def drain(robot: Name, session: Operating, farm: TheFarm) -> Response:
    """The operator's wish, as the API takes it."""
    await robots.drain_robot(robot, session.caller, farm)
    return RedirectResponse(f"/#robot-{robot}", status_code=303, headers=HEADERS)


@router.post("/robots/{robot}/resume")
async def resume(robot: Name, session: Operating, farm: TheFarm) -> Response:
    """Takes a drained robot into service again."""
    await robots.resume_robot(robot, session.caller, farm)
    return RedirectResponse(f"/#robot-{robot}", status_code=303, headers=HEADERS)
