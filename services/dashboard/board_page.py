"""The page of the leaderboard: which policy does a task best on this farm."""

from dataclasses import dataclass, field
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response

from api_schemas.job import TaskName
from api_schemas.leaderboard import BoardRow, Contest, Leaderboard
from api_schemas.physics import LARGEST_SCALE, SMALLEST_SCALE, ObjectName
from services.api.farm import Farm, TheFarm
from services.api.leaderboards import PhysicsNumber, best
from services.dashboard.figures import Bar
from services.dashboard.pages import PageRoute, page
from services.dashboard.recently import Recently
from services.dashboard.sessions import Session, TheSeal, session_of
from services.errors import Unauthorised
from services.jobs import leaderboard
from services.jobs.leaderboard import Wanted
from services.tokens import Caller

router = APIRouter(route_class=PageRoute, include_in_schema=False)
KEPT_S = 10.0
"""All who look share what was counted within so long: each count goes over all jobs, of 500 policies for some 35 ms."""
NOBODY = Caller("", "", frozenset())
"""An owner of nothing: every policy is another's."""


async def _looking(request: Request, farm: TheFarm, seal: TheSeal) -> Session | None:
    """Who looks; None without a session, where the operator shows the boards to everybody."""
    try:
        return await session_of(request, farm, seal)
    except Unauthorised:
        if not farm.settings.public_leaderboard:
            raise
        return None


@dataclass
class Boards:
    """The boards that there are, and those that somebody looked at a moment ago; belongs to the event loop."""

    contests: Recently[None, tuple[Contest, ...]] = field(default_factory=lambda: Recently(KEPT_S))
    boards: Recently[tuple[Wanted, str | None], Leaderboard] = field(default_factory=lambda: Recently(KEPT_S))

    async def look(self, wanted: Wanted | None, caller: Caller, farm: Farm) -> tuple[tuple[Contest, ...], Leaderboard | None]:
        """All that there are, and the wanted one; without one that of the task that most policies were tried at now."""
        contests = await self.contests.look(None, farm.clock.now_s(), lambda: _contests(farm))
        shown = _first(contests) if wanted is None else wanted
        if shown is None:
            return contests, None
        asked = shown, caller.sees_only
        return contests, await self.boards.look(asked, farm.clock.now_s(), lambda: best(shown, caller, farm))


async def _contests(farm: Farm) -> tuple[Contest, ...]:
    async with farm.database.read() as connection:
        return await leaderboard.contests(connection)


async def _boards(request: Request) -> Boards:
    return request.app.state.dashboard_boards


TheBoards = Annotated[Boards, Depends(_boards)]
SignedInOrPublic = Annotated[Session | None, Depends(_looking)]


@router.get("/leaderboard")
async def show_leaderboard(
    session: SignedInOrPublic,
    farm: TheFarm,
    known: TheBoards,
    task: TaskName | None = None,
    object: ObjectName = ObjectName.CUBE,
    object_scale: Annotated[float, Query(ge=SMALLEST_SCALE, le=LARGEST_SCALE)] = 1.0,
    physics: PhysicsNumber = None,
) -> Response:
    """The board of a task; without one that of the task that most policies were tried at on the farm's physics."""
    wanted = None if task is None else Wanted(task, object, object_scale, physics)
    contests, board = await known.look(wanted, NOBODY if session is None else session.caller, farm)
    bars = [] if board is None else [_bar(row) for row in board.rows]
    context = {"contests": contests, "board": board, "bars": bars}
    return page("leaderboard.html", session, title="Leaderboard", here="leaderboard", **context)


def _bar(row: BoardRow) -> Bar:
    low, high = row.interval_95
    return Bar((row.policy or "recipe")[:12], row.successes, row.trials, 100 * row.success_rate, 100 * low, 100 * high)


def _first(contests: tuple[Contest, ...]) -> Wanted | None:
    if not contests:
        return None
    most = max(contests, key=lambda contest: (contest.physics.is_now, contest.policies))
    return Wanted(most.task, most.object, most.object_scale, most.physics.number)
