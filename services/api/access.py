"""Who may call a route: dependencies that turn the Authorization header into a caller."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from api_schemas.token import Scope
from services.api.farm import TheFarm
from services.errors import Forbidden, Unauthorised
from services.tokens import Caller

_bearer = HTTPBearer(auto_error=False, description="A token of the farm: trifarm_<id>_<secret>")


async def _caller(
    request: Request, farm: TheFarm, credentials: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)]
) -> Caller:
    if credentials is None:
        raise Unauthorised("token-missing", "Send the header 'Authorization: Bearer trifarm_…'.")
    caller = await farm.tokens.caller(credentials.credentials)
    request.state.caller, request.state.credential = caller, caller.key  # for the limits and the audit line
    return caller


def _needs(*any_of: Scope) -> Callable[[Caller], Awaitable[Caller]]:
    async def check(caller: Annotated[Caller, Depends(_caller)]) -> Caller:
        if not caller.may(*any_of):
            has, wanted = ", ".join(sorted(caller.scopes)), " or ".join(any_of)
            raise Forbidden("scope-missing", f"This needs the scope {wanted}; the token of {caller.owner} has {has}.")
        return caller

    return check


async def _robot(caller: Annotated[Caller, Depends(_needs(Scope.ROBOT))]) -> Caller:
    if caller.robot is None and not caller.may(Scope.ADMIN):
        detail = "A token of the whole farm speaks for no robot; get the robot's own with POST /v1/robots/<robot>/token."
        raise Forbidden("token-of-no-robot", detail)
    return caller


AnyCaller = Annotated[Caller, Depends(_caller)]
User = Annotated[Caller, Depends(_needs(Scope.SUBMIT, Scope.OPERATE))]
Submitter = Annotated[Caller, Depends(_needs(Scope.SUBMIT))]
Operator = Annotated[Caller, Depends(_needs(Scope.OPERATE))]
RobotCaller = Annotated[Caller, Depends(_robot)]
"""A robot with its own token, or an administrator, who may speak for any (``robot`` is None)."""
Joining = Annotated[Caller, Depends(_needs(Scope.ROBOT))]
"""Who may ask for a robot's own token."""
Bearer = Annotated[HTTPAuthorizationCredentials, Depends(_bearer)]
Admin = Annotated[Caller, Depends(_needs(Scope.ADMIN))]
