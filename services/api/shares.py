"""Routes of shares: links to one report or one trial that need no token, where the farm allows them."""

from typing import Annotated

import structlog
from fastapi import APIRouter, Depends, Path, Request, Response

from api_schemas.share import NewShare, SharePage, ShareRequest
from services.api.access import User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import stored_report
from services.api.paging import encode, numbered
from services.api.trials import get_trial
from services.database.pages import Asked
from services.errors import NotFound, Refused
from services.jobs import shares, views
from services.tokens import Caller

log = structlog.get_logger()
router = APIRouter(prefix="/v1/shares", tags=["shares"])
ShareId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}$")]
AT = "/shared/"


@router.post("", status_code=201, responses=refusals(404, 409))
async def make_share(body: ShareRequest, request: Request, response: Response, caller: User, farm: TheFarm) -> NewShare:
    """Shares the report of a job, or a trial, with whoever has the link; it is shown this once."""
    made = await shared(body, request, caller, farm)
    response.headers["Location"] = f"/v1/shares/{made.share_id}"
    response.headers["Cache-Control"] = "no-store"
    return made


async def shared(wish: ShareRequest, request: Request, caller: Caller, farm: Farm) -> NewShare:
    """A new share of what the caller may see; the farm's log says that it was made, and never how its link reads.

    Raises:
        Refused: the farm shares nothing.
        NotFound: the caller has no such job or trial, or the trial has no log.
        Conflict: the job has no report yet.
    """
    if not farm.settings.shares:
        raise Refused(
            "shares-off", "This farm shares nothing without a token; its operator can allow it with TRIFARM_SHARES=true."
        )
    job_id = wish.job
    if wish.trial is not None:
        shown = await get_trial(wish.trial, caller, farm)
        if shown.log_sha256 is None:
            raise NotFound(
                "log-not-found", f"Trial {wish.trial} is {shown.state} and has no log; logs come with accepted outcomes."
            )
        job_id = shown.job_id
    assert job_id is not None, "either is named"
    if wish.trial is None:
        await stored_report(job_id, caller, farm)
    now_s = farm.clock.now_s()
    async with farm.database.write() as tx:
        row = await views.job_row(tx, job_id, caller.sees_only)
        made = shares.Wish(row.number, wish.trial, wish.at_s, wish.days, caller.owner, caller.token_id)
        kept, secret = await shares.make(tx, now_s, made)
    log.info("share made", share=kept.share_id, job=job_id, trial=wish.trial, owner=caller.owner, token_id=caller.token_id)
    moment = "" if wish.at_s is None else f"?t={wish.at_s:.2f}"
    url = f"{str(request.base_url).rstrip('/')}{AT}{secret}{moment}"
    return NewShare(**shares.show(kept, now_s).model_dump(), url=url)


@router.get("")
async def list_shares(caller: User, farm: TheFarm, asked: Annotated[Asked, Depends(numbered(usual=100, most=200))]) -> SharePage:
    """Shares that one made and shares of one's jobs, those that are over included, newest first; operators see all."""
    async with farm.database.read() as connection:
        page = await shares.page(connection, caller.sees_only, asked)
    now_s = farm.clock.now_s()
    return SharePage(shares=tuple(shares.show(row, now_s) for row in page.entries), next_cursor=encode(page.following))


@router.delete("/{share_id}", status_code=204)
async def revoke_share(share_id: ShareId, caller: User, farm: TheFarm) -> None:
    """Ends a share: from now on its link is answered 404."""
    async with farm.database.write() as tx:
        await shares.revoke(tx, farm.clock.now_s(), share_id, caller.sees_only)
