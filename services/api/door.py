"""What a request passes: a number, the rate limits, the watch over its token while it lasts, and the audit line at its end."""

import asyncio
import hashlib
import math
import secrets
import time
from collections import OrderedDict
from contextlib import suppress

import structlog
from prometheus_client import Counter
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Asgi

from services.api import audit, problems
from services.api.bodies import Incoming
from services.api.rate_limits import MOST_BUCKETS, Buckets, Draw, Limits, network
from services.database.database import AWAY
from services.errors import Unauthorised
from services.settings import Settings
from services.tokens import Caller, Tokens

RECHECK_S = 0.3
"""So often the token of a lasting request is looked at again; with ``REMEMBERED_S`` a revoked one ends well within a second."""
WATCHED = frozenset({"GET", "HEAD"})
"""Answers that are cut off. A change is not: its token is looked at while its body comes in, and then it is carried out."""
UNAUTHORISED = 401
SESSION_COOKIE = "trifarm_session"
"""In which a browser that has signed in on the dashboard shows its sealed token."""
REVOKED = "The token became invalid while its request was answered; ask for a new one."


class Door:
    """The outermost part of the application; draws from the buckets and remembers which tokens were good."""

    def __init__(self, app: ASGIApp, settings: Settings, tokens: Tokens, limits: Limits, problems: Counter) -> None:
        self._app, self._tokens, self._problems = app, tokens, problems
        self._body_stall_s = settings.body_stall_s
        self._limits = limits
        self._good: OrderedDict[str, Caller] = OrderedDict()

    async def __call__(self, scope: Asgi, receive: Receive, send: Send) -> None:
        """Serves one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        state = scope["state"] = {**scope.get("state", {}), "request_id": secrets.token_hex(8)}
        structlog.contextvars.bind_contextvars(request_id=state["request_id"])
        passage = _Passage(scope, send, self._problems)
        try:
            await self._serve(scope, receive, passage)
        finally:
            if passage.status == 0:
                audit.write(scope, 0, None)

    async def _serve(self, scope: Asgi, receive: Receive, passage: "_Passage") -> None:
        key, address = _key(scope), network((scope.get("client") or ("unknown",))[0])
        known = self._good.get(key)
        limits = self._limits
        buckets = limits.anonymous if known is None else limits.robots if known.robot else limits.users
        name = address if known is None else known.token_id
        draw = buckets.draw(name, time.monotonic())
        passage.limit(buckets, draw)
        if not draw.passes:
            scope["state"]["caller"] = known
            await _refuse(scope, receive, passage, draw, buckets)
            return
        is_known = known is not None or scope["method"] in WATCHED or await self._is_good(scope)
        watch = _Watch(self._tokens, scope, Incoming(scope, receive, self._body_stall_s, known=is_known), receive)
        await watch.over(self._app, passage)
        caller: Caller | None = scope["state"].get("caller")
        if passage.status == UNAUTHORISED:
            self._good.pop(key, None)
        elif caller is not None and known is None and key == scope["state"].get("credential"):
            buckets.give_back(name)  # whoever has a token is counted by it; a token beside it may be anybody's
            self._good[key] = caller
            if len(self._good) > MOST_BUCKETS:
                self._good.popitem(last=False)

    async def _is_good(self, scope: Asgi) -> bool:
        """Whether a token that is not known here is good, asked before its sender's body is taken in."""
        kind, _, bearer = Request(scope).headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer" or not bearer:
            return False
        try:
            await self._tokens.caller(bearer)
        except Unauthorised:
            return False
        except AWAY:
            return True  # the route will say so
        return True


class _Passage:
    """The way of an answer out: adds the headers of every answer, and writes the audit line when it is known."""

    def __init__(self, scope: Asgi, send: Send, problems: Counter) -> None:
        self._send, self._scope, self._problems = send, scope, problems
        self._limits: dict[str, str] = {}
        self.status, self.ended, self.is_stream = 0, False, False

    def limit(self, buckets: Buckets, draw: Draw) -> None:
        """What the answer tells of the asker's bucket."""
        if buckets.per_s:
            self._limits = {"RateLimit-Policy": buckets.policy(), "RateLimit": f'"requests";r={draw.left}'}

    async def __call__(self, message: Message) -> None:
        """Sends one message of the answer."""
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["X-Request-Id"] = self._scope["state"]["request_id"]
            headers.update(self._limits)
            self.status = message["status"]
            self.is_stream = headers.get("content-type", "").startswith("text/event-stream")
            if problem := self._scope["state"].get("problem"):
                self._problems.labels(problem).inc()
            # Before the answer goes out: whoever has it finds its line.
            audit.write(self._scope, self.status, headers.get("location"))
        await self._send(message)
        self.ended = message["type"] == "http.response.body" and not message.get("more_body", False)


class _Watch:
    """Looks again and again whether the token of a request still holds, for as long as the request lasts."""

    def __init__(self, tokens: Tokens, scope: Asgi, incoming: Incoming, receive: Receive) -> None:
        self._tokens, self._scope, self._receive = tokens, scope, receive
        self._incoming = incoming
        self._looked_s = time.monotonic()

    async def over(self, app: ASGIApp, passage: _Passage) -> None:
        """Has the request answered; an answer that lasts ends with its token."""
        if self._scope["method"] not in WATCHED:
            await app(self._scope, self._body, passage)
            return
        answering = asyncio.ensure_future(app(self._scope, self._receive, passage))
        try:
            while not (await asyncio.wait({answering}, timeout=RECHECK_S))[0]:
                if not await self._holds():
                    await self._cut(answering, passage)
                    return
            answering.result()
        finally:
            answering.cancel()
            if not answering.done():
                await asyncio.wait({answering})  # what it has of the database it gives back before anybody closes that

    async def _cut(self, answering: asyncio.Future[None], passage: _Passage) -> None:
        answering.cancel()
        with suppress(asyncio.CancelledError):
            await answering
        if passage.status == 0:
            refusal = problems.answer(Request(self._scope), 401, "token-revoked", "Token needed", REVOKED)
            await refusal(self._scope, self._receive, passage)
        elif passage.is_stream and not passage.ended:
            await passage({"type": "http.response.body", "body": b""})

    async def _body(self) -> Message:
        """The next part of a body; none is taken under a token that has ended."""
        message = await self._incoming()
        if message["type"] == "http.request" and time.monotonic() - self._looked_s > RECHECK_S and not await self._holds():
            raise Unauthorised("token-revoked", REVOKED)
        return message

    async def _holds(self) -> bool:
        self._looked_s = time.monotonic()
        caller: Caller | None = self._scope["state"].get("caller")
        lent: tuple[str, float] | None = self._scope["state"].get("lent")
        try:
            if lent is not None and not await self._tokens.lasts(*lent):
                return False
            return caller is None or await self._tokens.still_holds(caller)
        except AWAY:
            return True  # that the database is away for a moment says nothing about the token


def _key(scope: Asgi) -> str:
    """The hash of the token, or of the dashboard's cookie, that is shown, under which it is known here; empty without one."""
    request = Request(scope)
    kind, _, bearer = request.headers.get("authorization", "").partition(" ")
    shown = bearer if kind.lower() == "bearer" else request.cookies.get(SESSION_COOKIE, "")
    return hashlib.sha256(shown.encode()).hexdigest() if shown else ""


async def _refuse(scope: Asgi, receive: Receive, passage: _Passage, draw: Draw, buckets: Buckets) -> None:
    wait_s = max(1, math.ceil(draw.wait_s))
    whose = "this token" if scope["state"].get("caller") else "requests of this address without a known token"
    detail = f"The limit of {whose} is {buckets.per_s:g} requests a second in the long run; ask again after {wait_s} s."
    if whose == "this token":
        detail += " GET /v1/jobs/<job>/events tells of changes without being asked."
    headers = {"Retry-After": str(wait_s)}
    response = problems.answer(Request(scope), 429, "too-many-requests", "Too many requests", detail, headers=headers)
    await response(scope, receive, passage)
