"""Signed links: one log for ten minutes, for viewers that have no token of this farm."""

import hashlib
import hmac
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Annotated

import structlog
from fastapi import APIRouter, Depends, Path, Request, Response

from api_schemas.trial import Trial, ViewerLink
from services.api.access import User
from services.api.farm import Farm, TheFarm
from services.api.serving import stored_file
from services.api.trials import MCAP, TrialId, get_trial
from services.errors import Forbidden, NotFound, TooMany
from services.jobs.clock import iso
from services.jobs.lists import trial_row
from services.tokens import Caller

log = structlog.get_logger()
router = APIRouter(tags=["trials"])
LASTS_S = 600
MOST_READERS = 16
"""Answers to the links of one token that are under way at once; a viewer has a few, each of a part of the file."""
RETRY_AFTER_S = 5
USE = "viewer links"
FOR_ANY_SITE = {
    # The address itself is the permission, so that no other site gains anything by asking with a reader's cookies.
    "Access-Control-Allow-Origin": "*",
    "Access-Control-Allow-Methods": "GET, HEAD",
    "Access-Control-Allow-Headers": "Range, If-Range, If-None-Match",
    "Access-Control-Expose-Headers": "Content-Length, Content-Range, Accept-Ranges, ETag",
    "Access-Control-Allow-Private-Network": "true",
    "Access-Control-Max-Age": "600",
    "Cross-Origin-Resource-Policy": "cross-origin",
    "Cache-Control": "private, no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
ADDRESS = "/links/{expires_s}/{token_id}/{signature}/{trial_id}.mcap"


@dataclass(frozen=True)
class Link:
    """What a link is for: a log by its SHA-256, until when, and the token of who made it."""

    trial_id: str
    log_sha256: str
    token_id: str
    expires_s: int

    def signature(self, farm: Farm) -> str:
        """Which only this farm can make."""
        signed = f"{self.trial_id} {self.log_sha256} {self.token_id} {self.expires_s}"
        return hmac.new(farm.key.secret_for(USE), signed.encode(), hashlib.sha256).hexdigest()

    def path(self, farm: Farm) -> str:
        """Where the file is."""
        named = {"expires_s": self.expires_s, "token_id": self.token_id, "trial_id": self.trial_id}
        return ADDRESS.format(signature=self.signature(farm), **named)


@router.post("/v1/trials/{trial_id}/link")
async def make_link(trial_id: TrialId, request: Request, caller: User, farm: TheFarm) -> ViewerLink:
    """A link to the trial's log that needs no token: for this one file and ten minutes, and not after the caller's token."""
    link = linked(await get_trial(trial_id, caller, farm), caller, farm)
    url = str(request.base_url).rstrip("/") + link.path(farm)
    return ViewerLink(trial_id=trial_id, url=url, expires_at=iso(link.expires_s), lasts_s=LASTS_S)


def linked(shown: Trial, caller: Caller, farm: Farm) -> Link:
    """A new link to the log of a trial that the caller may see; the farm's log says that it was made, and never how it reads.

    Raises:
        NotFound: it has none.
    """
    if shown.log_sha256 is None:
        detail = f"Trial {shown.trial_id} is {shown.state} and has no log; logs come with accepted outcomes."
        raise NotFound("log-not-found", detail)
    log.info("link made", trial=shown.trial_id, owner=caller.owner, token_id=caller.token_id)
    return Link(shown.trial_id, shown.log_sha256, caller.token_id, int(farm.clock.now_s()) + LASTS_S)


@router.options(ADDRESS, include_in_schema=False)
async def ask_link() -> Response:
    """What a browser asks before it lets another site's page read the file."""
    return Response(status_code=204, headers=FOR_ANY_SITE)


async def _granted(
    expires_s: Annotated[int, Path(ge=0, le=10**11)],
    token_id: Annotated[str, Path(max_length=20)],
    signature: Annotated[str, Path(pattern=r"^[0-9a-f]{64}$")],
    trial_id: TrialId,
    request: Request,
    farm: TheFarm,
) -> Link:
    """The link of an address; its answer is broken off when the link is over (``lent`` is what the door looks at).

    Raises:
        Forbidden: it is none of this farm, or over.
    """
    async with farm.database.read() as connection:
        row = await trial_row(connection, trial_id)
    sha256 = None if row is None else row.log_sha256
    link = Link(trial_id, sha256 or "", token_id, expires_s)
    if sha256 is None or not hmac.compare_digest(link.signature(farm), signature):
        raise Forbidden(
            "link-not-ours", "This link was not made by this farm, or was changed; make a new one on the trial's page."
        )
    request.state.lent = token_id, expires_s
    if not await farm.tokens.lasts(token_id, expires_s):
        raise Forbidden(
            "link-over", "This link has expired: it lasts ten minutes, and no longer than its maker's token; make a new one."
        )
    return link


async def _reading(link: Annotated[Link, Depends(_granted)], request: Request) -> AsyncIterator[Link]:
    """The link, counted with its token for as long as it is read."""
    readers: Counter[str] = request.app.state.link_readers
    if readers[link.token_id] >= MOST_READERS:
        detail = f"{MOST_READERS} downloads by links of this token are under way, the limit; wait for one to end."
        raise TooMany("too-many-link-readers", detail, RETRY_AFTER_S)
    readers[link.token_id] += 1
    try:
        yield link
    finally:
        readers[link.token_id] -= 1
        if not readers[link.token_id]:
            del readers[link.token_id]


@router.api_route(ADDRESS, methods=["GET", "HEAD"], include_in_schema=False)
async def read_link(link: Annotated[Link, Depends(_reading)], request: Request, farm: TheFarm) -> Response:
    """The log, whole or in ranges."""
    client = (request.scope.get("client") or ("unknown",))[0]
    log.info("link read", trial=link.trial_id, token_id=link.token_id, client=client)
    answer = await stored_file(request, farm.files, link.log_sha256, MCAP, f"{link.trial_id}.mcap")
    answer.headers.update(FOR_ANY_SITE)
    return answer
