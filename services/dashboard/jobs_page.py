"""The page of jobs: which there are, found by state or by text, newest first."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Annotated, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.job import Job, JobState
from services.api.farm import Farm, TheFarm
from services.api.jobs import Search
from services.api.paging import decode_number, encode
from services.dashboard import live
from services.dashboard.figures import Bar
from services.dashboard.pages import PageRoute, page, part
from services.dashboard.sessions import Session, SignedIn
from services.database.pages import Asked
from services.jobs import views
from services.jobs.lists import JobFilter, job_page

router = APIRouter(route_class=PageRoute, include_in_schema=False)
ON_A_PAGE = 25


@dataclass(frozen=True)
class Wanted:
    """What the address of the page asks for."""

    state: JobState | None
    text: str
    cursor: str | None

    def address(self, **changes: str | None) -> str:
        """The address of the same list with changes."""
        asked = {"state": self.state and self.state.value, "q": self.text or None, "cursor": self.cursor} | changes
        given = {name: value for name, value in asked.items() if value}
        return "/jobs" + (f"?{urlencode(given)}" if given else "")


async def _wanted(
    state: Literal["", "queued", "running", "succeeded", "failed", "cancelled"] = "",
    q: Search = "",
    cursor: Annotated[str | None, Query(max_length=40)] = None,
) -> Wanted:
    return Wanted(JobState(state) if state else None, q.strip(), cursor or None)


TheWanted = Annotated[Wanted, Depends(_wanted)]


@dataclass(frozen=True)
class Line:
    """One job in the list."""

    job: Job
    bar: Bar
    why: str | None


async def parts(session: Session, farm: Farm, wanted: Wanted) -> dict[str, str]:
    """The list, and the way to the next page."""
    chosen = JobFilter(session.caller.sees_only, wanted.state, wanted.text)
    asked = Asked(ON_A_PAGE, None if wanted.cursor is None else decode_number(wanted.cursor))
    async with farm.database.read() as connection:
        found = await job_page(connection, chosen, asked)
        limit = farm.settings.user_trials_at_once
        jobs = await views.show_jobs(connection, found.entries, farm.fleet, farm.clock.now_s(), limit)
    lines = [Line(job, Bar.of(job.job_id, job.successes, job.trials_done), job.waiting_because or job.reason) for job in jobs]
    following = None if found.following is None else wanted.address(cursor=encode(found.following))
    shows_owner = session.caller.sees_only is None
    return {"jobs": part("jobs/list.html", lines=lines, following=following, wanted=wanted, shows_owner=shows_owner)}


@router.get("/jobs")
async def show_jobs(session: SignedIn, farm: TheFarm, wanted: TheWanted) -> Response:
    """The whole page."""
    made = await parts(session, farm, wanted)
    more = {"wanted": wanted, "states": list(JobState), "live": f"/live/jobs{wanted.address()[5:]}"}
    return page("jobs.html", session, parts=made, title="Jobs", here="jobs", **more)


@router.get("/live/jobs", response_class=EventSourceResponse)
async def stream_jobs(session: live.Watching, farm: TheFarm, wanted: TheWanted) -> AsyncIterator[ServerSentEvent]:
    """What changes in the list."""
    async for event in live.stream(farm, session, lambda: parts(session, farm, wanted)):
        yield event
