"""Signing in with a token of the farm, and out again."""

import re
from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from api_schemas.token import Scope
from services.api.farm import TheFarm
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.sessions import COOKIE, Changing, TheSeal, refuse_foreign, set_cookie
from services.errors import Forbidden, Unauthorised
from services.sharing import note_signed_out

router = APIRouter(route_class=PageRoute, include_in_schema=False)
OWN_PATH = re.compile(r"/(?![/\\])[\x21-\x7e]*")
"""A path of this farm; two slashes or a backslash would lead elsewhere."""


@router.get("/sign-in")
async def ask(then: str = "/") -> Response:
    """The form."""
    return page("sign_in.html", None, title="Sign in", then=own_path(then), problem=None)


@router.post("/sign-in")
async def sign_in(
    request: Request,
    farm: TheFarm,
    seal: TheSeal,
    token: Annotated[str, Form(max_length=300)],
    then: Annotated[str, Form(max_length=2000)] = "/",
) -> Response:
    """Takes the token once; from then on the cookie stands for it."""
    refuse_foreign(request)
    try:
        caller = await farm.tokens.caller(token.strip())
        request.state.caller = caller  # for the audit line
        if not caller.may(Scope.SUBMIT, Scope.OPERATE):
            raise Forbidden("scope-missing", f"The token of {caller.owner} may neither submit nor operate.")
    except (Unauthorised, Forbidden) as error:
        status, problem = error.status, error.detail
        return page("sign_in.html", None, status=status, title="Sign in", then=own_path(then), problem=problem)
    answer = RedirectResponse(own_path(then), status_code=303, headers=HEADERS)
    set_cookie(request, answer, seal.close(token.strip()))
    return answer


@router.post("/sign-out")
async def sign_out(session: Changing, farm: TheFarm) -> Response:
    """Ends the session, for whoever else has its cookie too and at all processes of the farm, and takes the cookie back."""
    async with farm.database.write() as tx:
        await note_signed_out(tx, *session.mark, farm.clock.now_s())
    # Last: where the row could not be written, whoever signed out can try again.
    session.end()
    answer = RedirectResponse("/sign-in", status_code=303, headers=HEADERS)
    answer.delete_cookie(COOKIE)
    return answer


def own_path(then: str) -> str:
    """Where to go after the sign-in: only somewhere on this farm."""
    return then if OWN_PATH.fullmatch(then) else "/"
