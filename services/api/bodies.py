"""The body of a request on its way in: no more of it than its route takes, and no longer than its sender goes on sending."""

import asyncio

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.types import Message, Receive
from starlette.types import Scope as Asgi

from services.errors import ServiceError, TooLarge, TooSlow

MAX_BODY_BYTES = 1024**2
"""Of every body but a file. FastAPI reads a body before it looks at the token, so that anybody may send one."""


class BodyRefused(HTTPException):
    """Carries ``refusal`` out of the reading of a body; of other errors there FastAPI makes a plain 400."""

    def __init__(self, refusal: ServiceError) -> None:
        super().__init__(refusal.status, refusal.detail)
        self.refusal = refusal


class Incoming:
    """Receives one request; owns how much of its body has come."""

    def __init__(self, scope: Asgi, receive: Receive, stall_s: float) -> None:
        self._scope, self._receive, self._stall_s = scope, receive, stall_s
        self._bytes, self._whole = 0, False

    async def __call__(self) -> Message:
        """The next message.

        Raises:
            BodyRefused: the body is larger than its route takes, or its sender has fallen silent.
        """
        if self._whole:  # what comes now is that the sender has left, whenever that is
            return await self._receive()
        self._check(max(self._bytes, self._announced()))
        try:
            async with asyncio.timeout(self._stall_s):
                message = await self._receive()
        except TimeoutError as error:
            detail = f"The body stalled for {self._stall_s:g} s after {self._bytes} bytes; send it again."
            raise BodyRefused(TooSlow("body-too-slow", detail)) from error
        self._bytes += len(message.get("body", b""))
        self._whole = not message.get("more_body", False)
        self._check(self._bytes)
        return message

    def _check(self, size: int) -> None:
        if size > MAX_BODY_BYTES and not self._is_file():
            detail = f"The body is larger than the {MAX_BODY_BYTES} bytes that this route takes; send less at once."
            raise BodyRefused(TooLarge("body-too-large", detail))

    def _announced(self) -> int:
        """What the header says, or 0; what comes is counted all the same."""
        text = Request(self._scope).headers.get("content-length", "")
        return int(text[:19]) if text.isascii() and text.isdigit() else 0

    def _is_file(self) -> bool:
        """Whether the route takes a file: it then states its body itself, looks at the token first and has its own limit."""
        return "requestBody" in (getattr(self._scope.get("route"), "openapi_extra", None) or {})
