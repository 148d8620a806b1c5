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

from api_schemas.error import MEDIA_TYPE, Problem
from services.errors import ServiceError

log = structlog.get_logger()


def install(app: FastAPI) -> None:
    """Makes the app answer every error with a problem document."""
    app.add_exception_handler(ServiceError, _service_error)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(DBAPIError, _database_error)
    app.add_exception_handler(Exception, _unexpected)


async def _service_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ServiceError)
    headers = {401: {"WWW-Authenticate": "Bearer"}, 503: {"Retry-After": "2"}}.get(error.status)
    return _answer(request, error.status, error.slug, error.title, error.detail, members=error.members, headers=headers)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    found = [
        {"where": ".".join(str(part) for part in each["loc"]), "message": each["msg"], "value": _short(each.get("input"))}
        for each in error.errors()
    ]
    detail = "; ".join(f"{each['where']}: {each['message']}" for each in found)
    return _answer(request, 422, "invalid-request", "Request is not valid", detail, members={"errors": found})


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    slug = {404: "no-such-route", 405: "method-not-allowed"}.get(error.status_code, "http-error")
    detail = f"{request.method} {request.url.path}: {error.detail}; /docs lists the routes."
    return _answer(request, error.status_code, slug, str(error.detail), detail, headers=error.headers)


async def _database_error(request: Request, error: Exception) -> JSONResponse:
    log.error("database error", path=request.url.path, exc_info=error)
    detail = "The database did not answer; nothing was changed by this request. Try again in a moment."
    return _answer(request, 503, "database-unavailable", "Not available now", detail, headers={"Retry-After": "2"})


async def _unexpected(request: Request, error: Exception) -> JSONResponse:
    log.error("unexpected error", path=request.url.path, exc_info=error)
    return _answer(request, 500, "internal-error", "Error of the farm", "The farm failed; its log says how. Please report it.")


def _answer(
    request: Request,
    status: int,
    slug: str,
    title: str,
    detail: str,
    *,
    members: Mapping[str, Any] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    problem = Problem(
        type=f"/problems/{slug}", title=title, status=status, detail=detail, instance=request.url.path, **(members or {})
    )
    content = jsonable_encoder(problem.model_dump(exclude_none=True))
    return JSONResponse(content, status_code=status, headers=headers, media_type=MEDIA_TYPE)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else text[:200] + "…"
