"""The page of the leaderboard: which policy does a task best on this farm."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, Response

from api_schemas.job import TaskName
from api_schemas.leaderboard import BoardRow, Contest
from api_schemas.physics import LARGEST_SCALE, SMALLEST_SCALE, ObjectName
from services.api.farm import TheFarm
from services.api.leaderboards import PhysicsNumber, best
from services.dashboard.figures import Bar
from services.dashboard.pages import PageRoute, page
from services.dashboard.sessions import Session, TheSeal, session_of
from services.errors import Unauthorised
from services.jobs import leaderboard
from services.jobs.leaderboard import Wanted
from services.tokens import Caller

router = APIRouter(route_class=PageRoute, include_in_schema=False)
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


SignedInOrPublic = Annotated[Session | None, Depends(_looking)]


@router.get("/leaderboard")
async def show_leaderboard(
    session: SignedInOrPublic,
    farm: TheFarm,
    task: TaskName | None = None,
    object: ObjectName = ObjectName.CUBE,
    object_scale: Annotated[float, Query(ge=SMALLEST_SCALE, le=LARGEST_SCALE)] = 1.0,
    physics: PhysicsNumber = None,
) -> Response:
    """The board of a task; without one that of the task that most policies were tried at on the farm's physics."""
    async with farm.database.read() as connection:
        contests = await leaderboard.contests(connection)
    wanted = _wanted(contests) if task is None else Wanted(task, object, object_scale, physics)
    board = None if wanted is None else await best(wanted, NOBODY if session is None else session.caller, farm)
    bars = [] if board is None else [_bar(row) for row in board.rows]
    context = {"contests": contests, "board": board, "bars": bars}
    return page("leaderboard.html", session, title="Leaderboard", here="leaderboard", **context)


def _bar(row: BoardRow) -> Bar:
    low, high = row.interval_80
    return Bar((row.policy or "recipe")[:12], row.successes, row.trials, 100 * row.success_rate, 100 * low, 100 * high)


def _wanted(contests: tuple[Contest, ...]) -> Wanted | None:
    if not contests:
        return None
    most = max(contests, key=lambda contest: (contest.physics.is_now, contest.policies))
    return Wanted(most.task, most.object, most.object_scale, most.physics.number)
