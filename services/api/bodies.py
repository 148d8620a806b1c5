"""The body of a request on its way in: no more of it than its route takes, and no longer than its sender goes on sending."""

import asyncio
import time

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.types import Message, Receive
from starlette.types import Scope as Asgi

from services.errors import ServiceError, TooLarge, TooSlow

MAX_BODY_BYTES = 1024**2
"""Of every body but a file."""
STRANGERS_BODY_BYTES = 16 * 1024
"""Of a body that comes without a token that is known to be good: FastAPI reads a body before it looks at the token."""
WHOLE_WITHIN = 4.0
"""A known sender has so many times the time of a stall for a body that is no file; a stranger has that time once."""
FILE_GRACE_S, FILE_BYTES_PER_S = 120.0, 1000.0
"""A file that still comes after the first must have come at the second, on the whole."""


class BodyRefused(HTTPException):
    """Carries ``refusal`` out of the reading of a body; of other errors there FastAPI makes a plain 400."""

    def __init__(self, refusal: ServiceError) -> None:
        super().__init__(refusal.status, refusal.detail)
        self.refusal = refusal


class Incoming:
    """Receives one request; owns how much of its body has come.

    Args:
        scope: of the request.
        receive: gives its parts.
        stall_s: how long nothing of it may come.
        known: whether it came with a token that is good.
    """

    def __init__(self, scope: Asgi, receive: Receive, stall_s: float, *, known: bool) -> None:
        self._scope, self._receive, self._stall_s, self._known = scope, receive, stall_s, known
        self._bytes, self._whole = 0, False
        self._began_s = time.monotonic()

    async def __call__(self) -> Message:
        """The next message.

        Raises:
            BodyRefused: the body is larger than its route takes, or its sender has fallen silent.
        """
        if self._whole:  # what comes now is that the sender has left, whenever that is
            return await self._receive()
        self._check(max(self._bytes, self._announced()))
        try:
            async with asyncio.timeout(self._waits_s()):
                message = await self._receive()
        except TimeoutError as error:
            after_s = time.monotonic() - self._began_s
            detail = f"The body stalled or lasted too long: {self._bytes} bytes after {after_s:.0f} s; send it again."
            raise BodyRefused(TooSlow("body-too-slow", detail)) from error
        self._bytes += len(message.get("body", b""))
        self._whole = not message.get("more_body", False)
        self._check(self._bytes)
        return message

    def _waits_s(self) -> float:
        """How long the next part may take to come: no stall, and what has come must be worth the time."""
        lasts_s = time.monotonic() - self._began_s
        if self._is_file():
            left_s = FILE_GRACE_S + self._bytes / FILE_BYTES_PER_S - lasts_s
        else:
            left_s = (WHOLE_WITHIN if self._known else 1.0) * self._stall_s - lasts_s
        return max(0.0, min(self._stall_s, left_s))

    def _check(self, size: int) -> None:
        if self._is_file():
            return
        if size > MAX_BODY_BYTES:
            detail = f"The body is larger than the {MAX_BODY_BYTES} bytes that this route takes; send less at once."
            raise BodyRefused(TooLarge("body-too-large", detail))
        if size > STRANGERS_BODY_BYTES and not self._known:
            detail = f"Without a valid token {STRANGERS_BODY_BYTES} bytes are taken, with one {MAX_BODY_BYTES}; send one."
            raise BodyRefused(TooLarge("body-too-large", detail))

    def _announced(self) -> int:
        """What the header says, or 0; what comes is counted all the same."""
        text = Request(self._scope).headers.get("content-length", "")
        return int(text[:19]) if text.isascii() and text.isdigit() else 0

    def _is_file(self) -> bool:
        """Whether the route takes a file: it then states its body itself, looks at the token first and has its own limit."""
        return "requestBody" in (getattr(self._scope.get("route"), "openapi_extra", None) or {})
