"""What is shared: one report or one trial for whoever has its link, and the page of those that one has shared."""

from collections.abc import Callable, Coroutine
from typing import Annotated, Any

import structlog
from fastapi import APIRouter, Depends, Form, Path, Request, Response

from api_schemas.share import LATEST_S, MOST_DAYS, USUAL_DAYS, ShareRequest
from api_schemas.token import Scope
from services.api import jobs, trials
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.api.rate_limits import Buckets
from services.api.shares import AT, ShareId, revoke_share, shared
from services.api.trials import TrialId
from services.dashboard.job_page import report_page
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.replays import TheReplays, sent
from services.dashboard.sessions import Changing, Session, SignedIn
from services.database.pages import Asked
from services.database.rows import AnyRow
from services.errors import TooMany
from services.jobs import shares
from services.jobs.clock import iso
from services.tokens import Caller

log = structlog.get_logger()
ON_A_PAGE = 100
OPENINGS_PER_S = 2.0
"""Of one link, over all who have it, in the long run; ten seconds' worth at once."""
FOR_ANYBODY = HEADERS | {"Referrer-Policy": "no-referrer", "Cache-Control": "no-store", "X-Robots-Tag": "noindex, nofollow"}


class SharedRoute(PageRoute):
    """A route without a session, whose answers, refusals too, tell no other site of the link and are kept nowhere."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler with these headers."""
        handle = super().get_route_handler()

        async def shown(request: Request) -> Response:
            answer = await handle(request)
            named = {name: value for name, value in FOR_ANYBODY.items() if name != "Content-Security-Policy"}
            answer.headers.update(named)
            return answer

        return shown


router = APIRouter(route_class=PageRoute, include_in_schema=False)
anybody = APIRouter(route_class=SharedRoute, include_in_schema=False)


def openings() -> Buckets:
    """How often links may be opened."""
    return Buckets(OPENINGS_PER_S)


async def _opened(secret: Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{32}$")], request: Request, farm: TheFarm) -> AnyRow:
    """The share of a link.

    Raises:
        NotFound: there is none, it is over, or so is the token of who made it; or the farm shares nothing any more.
        TooMany: it is opened too often.
    """
    now_s = farm.clock.now_s()
    if not farm.settings.shares:
        raise shares.missing()
    async with farm.database.read() as connection:
        row = await shares.opened(connection, secret, now_s)
    if not await farm.tokens.lasts(row.token_id, row.expires_s):
        raise shares.missing()
    draw = request.app.state.dashboard_openings.draw(row.share_id, now_s)
    if not draw.passes:
        raise TooMany("shared-too-often", "This link is opened more often than it may be; try again in a moment.", 5)
    client = (request.scope.get("client") or ("unknown",))[0]
    log.info("share read", share=row.share_id, client=client)
    return row


Opened = Annotated[AnyRow, Depends(_opened)]


def _reader(row: AnyRow) -> Caller:
    """In whose name the one thing that is shared is looked up: the job's owner, who may see no truth."""
    return Caller(row.token_id, row.job_owner, frozenset({Scope.SUBMIT}))


@anybody.get("/shared/{secret}")
async def show_shared(secret: str, row: Opened, farm: TheFarm) -> Response:
    """The signed report, or the replay of the trial from its moment on."""
    if row.trial_id is None:
        return await report_page(row.job_id, _reader(row), farm)
    shown = await trials.get_trial(row.trial_id, _reader(row), farm)
    if shown.log_sha256 is None:
        raise shares.missing()
    job = await jobs.get_job(shown.job_id, _reader(row), farm)
    context = {"trial": shown, "job": job, "source": f"{AT}{secret}/replay", "at_s": row.at_s}
    context["expires_at"] = iso(row.expires_s)
    title = f"Trial {shown.ordinal} of {job.policy_name or 'an identification'}"
    return page("shared/trial.html", None, title=title, **context)


@anybody.get("/shared/{secret}/replay")
async def get_shared_replay(row: Opened, request: Request, farm: TheFarm, replays: TheReplays) -> Response:
    """What is drawn of the trial: what its robot measured, and nothing of the truth, also where the log has both."""
    if row.trial_id is None:
        raise shares.missing()
    shown = await trials.get_trial(row.trial_id, _reader(row), farm)
    if shown.log_sha256 is None:
        raise shares.missing()
    return await sent(await replays.measured(farm, row.job_owner, shown.log_sha256), request)


@router.get("/shares")
async def show_shares(session: SignedIn, farm: TheFarm) -> Response:
    """What one has shared, and how to end it."""
    async with farm.database.read() as connection:
        found = await shares.page(connection, session.caller.sees_only, Asked(ON_A_PAGE))
    listed = [shares.show(row, farm.clock.now_s()) for row in found.entries]
    return page("shared/list.html", session, title="Shared", here="jobs", shares=listed, made=None, allowed=farm.settings.shares)


@router.post("/shares/{share_id}/revoke")
async def revoke(share_id: ShareId, session: Changing, farm: TheFarm) -> Response:
    """Ends a share at once."""
    await revoke_share(share_id, session.caller, farm)
    return await show_shares(session, farm)


Days = Annotated[float, Form(gt=0, le=MOST_DAYS)]


@router.post("/jobs/{job_id}/share")
async def share_report(job_id: JobId, request: Request, session: Changing, farm: TheFarm, days: Days = USUAL_DAYS) -> Response:
    """Shares the job's report, and shows the link this once."""
    return await _made(ShareRequest(job=job_id, days=days), request, session, farm)


@router.post("/trials/{trial_id}/share")
async def share_trial(
    trial_id: TrialId,
    request: Request,
    session: Changing,
    farm: TheFarm,
    days: Days = USUAL_DAYS,
    at_s: Annotated[float, Form(ge=0, le=LATEST_S)] = 0.0,
) -> Response:
    """Shares the trial from a moment on, and shows the link this once."""
    return await _made(ShareRequest(trial=trial_id, at_s=at_s, days=days), request, session, farm)


async def _made(wish: ShareRequest, request: Request, session: Session, farm: Farm) -> Response:
    made = await shared(wish, request, session.caller, farm)
    async with farm.database.read() as connection:
        found = await shares.page(connection, session.caller.sees_only, Asked(ON_A_PAGE))
    listed = [shares.show(row, farm.clock.now_s()) for row in found.entries]
    return page("shared/list.html", session, title="Shared", here="jobs", shares=listed, made=made, allowed=True)
