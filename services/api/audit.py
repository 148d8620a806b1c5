"""Audit lines: for every request that could change something one line of who asked, for what, on what, and what came of it."""

from collections.abc import Mapping
from typing import Any

import structlog
from fastapi.routing import APIRoute
from starlette.routing import Match
from starlette.types import Scope

from services.settings import AUDIT
from services.tokens import Caller

log = structlog.get_logger(AUDIT)
CHANGES_NOTHING = frozenset({"GET", "HEAD", "OPTIONS"})
NOWHERE = "(no such route)"


def operation_of(scope: Scope) -> APIRoute | None:
    """The route that a request is for, also of one that did not get as far as to it."""
    reached = scope.get("route")
    if isinstance(reached, APIRoute) and scope["method"] in (reached.methods or ()):
        return reached
    found = [route for route in scope["app"].state.operations if route.matches(scope)[0] is Match.FULL]
    return found[0] if found else None


def write(scope: Scope, status: int, made: str | None) -> None:
    """One line, if the request could have changed something.

    It holds nothing as it was sent but what has the form of an id: whoever pastes a token into an address must not find it
    in the farm's log.

    Args:
        scope: of the request, with what its handling left in ``state``.
        status: the answer's; 0 if there was none.
        made: address of what the request made.
    """
    if scope["method"] in CHANGES_NOTHING:
        return
    operation, state = operation_of(scope), scope["state"]
    caller: Caller | None = state.get("caller")
    log.info(
        AUDIT,
        action=f"{_method(scope)} {NOWHERE if operation is None else operation.path}",
        on={} if operation is None else _ids(operation, scope),
        owner=None if caller is None else caller.owner,
        token_id=state.get("token_id") if caller is None else caller.token_id,
        robot=None if caller is None else caller.robot,
        client=(scope.get("client") or ("unknown",))[0],
        status=status,
        outcome=outcome(status),
        problem=state.get("problem"),
        made=made,
        request_id=state["request_id"],
    )


def outcome(status: int) -> str:
    """What came of it, in a word."""
    if 200 <= status < 400:
        return "done"
    return "refused" if 400 <= status < 500 else "failed"


def _method(scope: Scope) -> str:
    method = scope["method"]
    is_known = method == "PATCH" or any(method in route.methods for route in scope["app"].state.operations)
    return method if is_known else "(other)"


def _ids(operation: APIRoute, scope: Scope) -> dict[str, str]:
    """The ids in the address that have the form which their route asks for."""
    values: Mapping[str, Any] = operation.matches(scope)[1]["path_params"]
    fields = {field.alias: field for field in operation.dependant.path_params}
    return {name: str(value) for name, value in values.items() if name in fields and _fits(fields[name], value)}


def _fits(field: Any, value: Any) -> bool:
    _, errors = field.validate(value, {}, loc=("path", field.alias))
    return not errors
