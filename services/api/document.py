"""The served OpenAPI document: what FastAPI makes of the routes, and every way in which a request can be refused."""

from collections.abc import Iterable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from api_schemas.error import MEDIA_TYPE, Problem

BINARY = {"type": "string", "format": "binary"}
PROBLEMS = {
    400: "The request cannot be read",
    401: "There is no token, or none that is valid",
    403: "The token may not do this, or a share is used up",
    404: "What is named does not exist, or is another's",
    408: "The body did not come in time",
    409: "The present state does not allow it",
    413: "The body is too large",
    416: "The range lies outside the file",
    422: "The content cannot be accepted",
    429: "More at once than one may ask for; Retry-After says when to ask again",
    503: "A part of the farm is away for now",
}
ALWAYS = (429, 503)
"""Every route can be asked too often, and the database can be away."""
WITH_TOKEN = (401, 403)
WITH_BODY = (400, 408, 413)
_SCHEMA = {"$ref": "#/components/schemas/Problem"}

Responses = dict[int | str, dict[str, Any]]


def refusals(*statuses: int) -> Responses:
    """The responses of a route that can be refused with these statuses, besides those that its form implies."""
    return {status: {"model": Problem, "description": PROBLEMS[status]} for status in statuses}


def files(media_type: str) -> Responses:
    """The responses of a route that answers with a stored file, or a part of it."""
    content = {media_type: {"schema": BINARY}}
    whole = {200: {"content": content}, 206: {"description": "The asked part", "content": content}}
    return {**whole, 304: {"description": "The file that the reader has"}, **refusals(404, 416)}


def install(app: FastAPI) -> None:
    """Has the app serve the complete document."""

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            made = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
            app.openapi_schema = _completed(made)
        return app.openapi_schema

    app.openapi = document


def _completed(document: dict[str, Any]) -> dict[str, Any]:
    schemas = document["components"]["schemas"]
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    schemas["Problem"] = Problem.model_json_schema()
    for path in document["paths"].values():
        for operation in path.values():
            responses = operation["responses"]
            for status in (*_implied(operation), *(int(known) for known in responses if int(known) in PROBLEMS)):
                responses[str(status)] = _problem(status)
    return document


def _implied(operation: dict[str, Any]) -> Iterable[int]:
    """What a route can be refused with because of its form."""
    yield from ALWAYS
    if operation.get("security"):
        yield from WITH_TOKEN
    if "requestBody" in operation:
        yield from WITH_BODY
    if any(parameter["in"] == "path" for parameter in operation.get("parameters", ())):
        yield 404
    if "422" in operation["responses"]:
        yield 422


def _problem(status: int) -> dict[str, Any]:
    response: dict[str, Any] = {"description": PROBLEMS[status], "content": {MEDIA_TYPE: {"schema": _SCHEMA}}}
    if status == 429:
        response["headers"] = {"Retry-After": {"description": "seconds", "schema": {"type": "integer", "minimum": 1}}}
    return response
