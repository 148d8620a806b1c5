"""The pages of ladders: success with its interval against training step, as it comes in."""

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.ladder import Ladder
from services.api.farm import Farm, TheFarm
from services.api.ladders import LadderId, seen_ladder
from services.api.paging import decode_number, encode
from services.dashboard import figures, live
from services.dashboard.pages import PageRoute, page, part
from services.dashboard.sessions import Session, SignedIn
from services.database.pages import Asked
from services.jobs import ladders

router = APIRouter(route_class=PageRoute, include_in_schema=False)
ON_A_PAGE = 25
MOST_COMPARED = 12


async def parts(session: Session, farm: Farm, ladder_id: str) -> dict[str, str]:
    """The parts of the page.

    Raises:
        NotFound: there is no such ladder, or it is another's.
    """
    ladder = await seen_ladder(ladder_id, session.caller, farm)
    at_every_look = ladder.ends is not None
    bars = [figures.Bar.of(rung.job_id, rung.successes, rung.trials_done, at_every_look=at_every_look) for rung in ladder.rungs]
    steps = [rung.step for rung in ladder.rungs]
    chart = figures.climbing([(step, bar) for step, bar in zip(steps, bars, strict=True)])
    return {
        "head": part("ladder/head.html", ladder=ladder, best=_best(ladder), alike=_alike(ladder)),
        "figure": part("ladder/figure.html", ladder=ladder, chart=chart),
        "rungs": part("ladder/rungs.html", ladder=ladder, bars=bars, comparable=_comparable(ladder)),
    }


def _best(ladder: Ladder) -> int | None:
    """The place of the best rung."""
    return next((at for at, rung in enumerate(ladder.rungs) if rung.job_id == ladder.best), None)


def _alike(ladder: Ladder) -> list[str]:
    """The steps of rungs that cannot be told from the best."""
    at = _best(ladder)
    best = set() if at is None else set(ladder.rungs[at].letters or "")
    return [f"{rung.step:.10g}" for rung in ladder.rungs if rung.job_id != ladder.best and best & set(rung.letters or "")]


def _comparable(ladder: Ladder) -> str | None:
    """The jobs to compare goal by goal: the last that ended, each against the first."""
    ended = [rung.job_id for rung in ladder.rungs if rung.state == "succeeded"]
    return ",".join([ended[0], *ended[1:][-MOST_COMPARED + 1 :]]) if len(ended) > 1 else None


@router.get("/ladders")
async def show_ladders(session: SignedIn, farm: TheFarm, cursor: Annotated[str | None, Query(max_length=40)] = None) -> Response:
    """The list."""
    asked = Asked(ON_A_PAGE, None if cursor is None else decode_number(cursor))
    async with farm.database.read() as connection:
        found = await ladders.lines(connection, session.caller.sees_only, asked)
    context = {"lines": found.entries, "following": encode(found.following), "cursor": cursor}
    return page("ladders.html", session, title="Ladders", here="ladders", **context)


@router.get("/ladders/{ladder_id}")
async def show_ladder(ladder_id: LadderId, session: SignedIn, farm: TheFarm) -> Response:
    """The whole page."""
    made = await parts(session, farm, ladder_id)
    return page("ladder.html", session, parts=made, title="Ladder", here="ladders", live=f"/ladders/{ladder_id}/live")


async def _seen(ladder_id: LadderId, session: SignedIn, farm: TheFarm) -> str:
    return (await seen_ladder(ladder_id, session.caller, farm)).ladder_id


@router.get("/ladders/{ladder_id}/live", response_class=EventSourceResponse)
async def stream_ladder(
    ladder_id: Annotated[str, Depends(_seen)], session: live.Watching, farm: TheFarm
) -> AsyncIterator[ServerSentEvent]:
    """What changes on the page."""
    async for event in live.stream(farm, session, lambda: parts(session, farm, ladder_id)):
        yield event
