"""Every error of the API as an RFC 9457 problem document."""

from collections.abc import Mapping
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.encoders import jsonable_encoder
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from api_schemas.error import MEDIA_TYPE, Problem
from services.api.bodies import BodyRefused
from services.database.database import is_full_database, is_of_value
from services.errors import DISK_FULL, ServiceError, TooMany
from trial_logs.disk import is_full

log = structlog.get_logger()


def install(app: FastAPI) -> None:
    """Makes the app answer every error with a problem document."""
    app.add_exception_handler(ServiceError, _service_error)
    app.add_exception_handler(BodyRefused, _body_refused)
    app.add_exception_handler(ClientDisconnect, _broken_off)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(DBAPIError, database_error)
    app.add_exception_handler(UnicodeEncodeError, _unfit)  # half of a surrogate pair, which JSON can name and UTF-8 cannot
    app.add_exception_handler(OverflowError, _unfit)  # a number beyond 64 bits, of which SQLite's driver says so
    app.add_exception_handler(OSError, _system_error)
    app.add_exception_handler(Exception, _unexpected)


async def _service_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ServiceError)
    headers = {401: {"WWW-Authenticate": "Bearer"}, 408: {"Connection": "close"}, 503: {"Retry-After": "2"}}.get(error.status)
    if isinstance(error, TooMany):
        headers = {"Retry-After": str(error.retry_after_s)}
    request.state.token_id = error.members.get("token_id")
    return answer(request, error.status, error.slug, error.title, error.detail, members=error.members, headers=headers)


async def _body_refused(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, BodyRefused)
    return await _service_error(request, error.refusal)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    found = [
        {"where": ".".join(str(part) for part in each["loc"]), "message": each["msg"], "value": _short(each.get("input"))}
        for each in error.errors()
    ]
    detail = "; ".join(f"{each['where']}: {each['message']}" for each in found)
    return answer(request, 422, "invalid-request", "Request is not valid", detail, members={"errors": found})


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    slug = {404: "no-such-route", 405: "method-not-allowed"}.get(error.status_code, "http-error")
    detail = f"{request.method} {request.url.path}: {error.detail}; /openapi.json lists the routes."
    headers = error.headers
    if error.status_code == 405:
        headers = {"Allow": ", ".join(sorted(_methods(request)))}
    return answer(request, error.status_code, slug, str(error.detail), detail, headers=headers)


def _methods(request: Request) -> set[str]:
    """What may be done with a path: several routes can share it, and the first alone is asked."""
    found = [route for route in request.app.state.operations if route.matches(request.scope)[0] is not Match.NONE]
    return {method for route in found for method in route.methods}


async def database_error(request: Request, error: Exception) -> JSONResponse:
    """The answer to a request whose statement failed: it is at fault where it named a value that no database keeps."""
    assert isinstance(error, DBAPIError)
    if is_of_value(error):
        return await _unfit(request, error.orig if isinstance(error.orig, Exception) else error)
    error.hide_parameters = True  # hashes of tokens, keys and manifests of users are among them
    log.error("database error", route=_route(request), exc_info=error)
    if is_full_database(error):
        return answer(request, 503, "disk-full", "Not available now", DISK_FULL, headers={"Retry-After": "2"})
    detail = "The database did not answer; nothing was changed by this request. Try again in a moment."
    return answer(request, 503, "database-unavailable", "Not available now", detail, headers={"Retry-After": "2"})


async def _unfit(request: Request, error: Exception) -> JSONResponse:
    log.warning("value refused by the database", route=_route(request), kind=type(error).__name__)
    detail = "The database cannot store a value of this request, such as a NUL character in a text; leave it out."
    return answer(request, 422, "value-unfit", "Content refused", detail)


async def _broken_off(request: Request, error: Exception) -> JSONResponse:
    """The sender of a body has left; nobody reads this answer."""
    assert isinstance(error, ClientDisconnect)
    log.info("request broken off by its sender", route=_route(request))
    return answer(request, 400, "broken-off", "Request broken off", "The body ended before it was whole; send it again.")


async def _system_error(request: Request, error: Exception) -> JSONResponse:
    """A full disk under whatever the request would have written, or an error that nobody expected."""
    if not is_full(error):
        return await _unexpected(request, error)
    log.error("disk full", route=_route(request), reason=str(error))
    return answer(request, 503, "disk-full", "Not available now", DISK_FULL, headers={"Retry-After": "2"})


async def _unexpected(request: Request, error: Exception) -> JSONResponse:
    log.error("unexpected error", route=_route(request), exc_info=error)
    number = getattr(request.state, "request_id", "unknown")
    detail = f"Internal error; the farm's log explains it under the request {number}. Please report it."
    return answer(request, 500, "internal-error", "Error of the farm", detail, headers={"X-Request-Id": number})


def _route(request: Request) -> str:
    """The route without its ids: whatever was put into an address must not get into the log with it."""
    return getattr(request.scope.get("route"), "path", "unknown")


def answer(
    request: Request,
    status: int,
    slug: str,
    title: str,
    detail: str,
    *,
    members: Mapping[str, Any] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """A problem document as the answer; the audit line of the request names it."""
    request.state.problem = slug
    problem = Problem(
        type=f"/problems/{slug}", title=title, status=status, detail=detail, instance=request.url.path, **(members or {})
    )
    content = jsonable_encoder(problem.model_dump(exclude_none=True))
    return JSONResponse(content, status_code=status, headers=headers, media_type=MEDIA_TYPE)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else text[:200] + "…"
