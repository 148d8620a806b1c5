"""How pages are made: templates that escape whatever they show, headers that let nothing foreign in, errors as pages."""

import json
from collections.abc import Callable, Coroutine, Mapping
from inspect import isawaitable
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, RedirectResponse
from fastapi.routing import APIRoute
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException

from api_schemas.success_rate import SHOWN, SHOWN_AT_EVERY_LOOK
from api_schemas.visible import visible
from services.api import problems
from services.dashboard import words
from services.dashboard.sessions import COOKIE, Session
from services.errors import ServiceError, TooMany, Unauthorised, Unavailable

FOLDER = Path(__file__).parent
FOR_NOW = frozenset({TooMany.status, Unavailable.status})
NOT_FOUND = 404
AGAIN_AFTER_S = 5
"""A page that cannot be shown for now is loaded again by itself after so long: nobody need be there to do it."""
NOTHING_FOREIGN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
)
HEADERS = {
    "Content-Security-Policy": NOTHING_FOREIGN,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def _shown(value: Any) -> Any:
    """What stands for a value on a page; what it holds of characters that nobody sees is shown."""
    return visible(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _environment() -> Environment:
    made = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= words.FILTERS
    shown: dict[str, Any] = {"interval": SHOWN, "interval_at_every_look": SHOWN_AT_EVERY_LOOK}
    made.globals |= shown
    return made


_ENVIRONMENT = _environment()


def part(template: str, **context: Any) -> str:
    """A part of a page as HTML; whatever is no markup of ours is escaped."""
    return _ENVIRONMENT.get_template(template).render(context)


def page(
    template: str, session: Session | None, *, parts: Mapping[str, str] | None = None, status: int = 200, **context: Any
) -> Response:
    """A whole page; ``parts`` are those of it that are renewed while somebody looks."""
    made = {name: Markup(html) for name, html in (parts or {}).items()}  # noqa: S704 - each was rendered by ``part``
    html = part(template, session=session, parts=made, **context)
    return HTMLResponse(html, status_code=status, headers=HEADERS)


class PageRoute(APIRoute):
    """A route for people: who is not signed in is led to the sign-in, and errors are pages."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler with its errors shown."""
        handle = super().get_route_handler()

        async def shown(request: Request) -> Response:
            try:
                return await handle(request)
            except Unauthorised as error:
                return _to_sign_in(request, error)
            except TooMany as error:
                return _ask_later(request, error)
            except DBAPIError as error:
                return _again(request, await problems.database_error(request, error), AGAIN_AFTER_S)
            except ServiceError as error:
                answer = error_page(request, error.status, error.title, error.detail)
                return _again(request, answer, AGAIN_AFTER_S)
            except RequestValidationError as error:
                found = "; ".join(f"{'.'.join(str(at) for at in each['loc'])}: {each['msg']}" for each in error.errors())
                return error_page(request, 422, "Not understood", found)

        return shown


def error_page(request: Request, status: int, title: str, detail: str) -> Response:
    """An error as a page, from which whoever is signed in gets on."""
    return page("error.html", None, status=status, title=title, detail=detail, navigates=COOKIE in request.cookies)


def not_found(app: FastAPI) -> None:
    """Makes addresses that lead nowhere answer browsers with a page; programs get the document that they always got."""
    as_document = app.exception_handlers[HTTPException]

    async def shown(request: Request, error: Exception) -> Response:
        if isinstance(error, HTTPException) and error.status_code == NOT_FOUND and reads_html(request):
            request.state.problem = "no-such-route"
            detail = f"There is nothing at {request.url.path}; the address may be mistyped, or from another version."
            return error_page(request, NOT_FOUND, "Not found", detail)
        answer = as_document(request, error)
        return await answer if isawaitable(answer) else answer

    app.add_exception_handler(HTTPException, shown)


def takes_gzip(request: Request) -> bool:
    """Whether whoever asks can unpack gzip; only what holds nobody's secrets beside others' words is packed."""
    return "gzip" in request.headers.get("accept-encoding", "")


def reads_html(request: Request) -> bool:
    """Whether a person's browser asks for a page."""
    return "text/html" in request.headers.get("accept", "")


def _ask_later(request: Request, error: TooMany) -> Response:
    headers = HEADERS | {"Retry-After": str(error.retry_after_s)}
    if not reads_html(request):
        return problems.answer(request, error.status, error.slug, error.title, error.detail, headers=headers)
    answer = error_page(request, error.status, error.title, error.detail)
    answer.headers.update(headers)
    return _again(request, answer, error.retry_after_s)


def _again(request: Request, answer: Response, after_s: int) -> Response:
    """The answer; if it says that a page cannot be shown for now, a browser is told to ask again."""
    if request.method == "GET" and answer.status_code in FOR_NOW:
        answer.headers["Refresh"] = str(after_s)
    return answer


def _to_sign_in(request: Request, error: Unauthorised) -> Response:
    if request.method != "GET" or not reads_html(request):
        return Response(json.dumps({"detail": error.detail}), status_code=401, media_type="application/json", headers=HEADERS)
    back = request.url.path + (f"?{request.url.query}" if request.url.query else "")
    answer = RedirectResponse(f"/sign-in?then={quote(back)}", status_code=303, headers=HEADERS)
    if error.slug != "session-missing":
        answer.delete_cookie(COOKIE)
    return answer
