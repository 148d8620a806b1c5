"""Sessions of the dashboard: a cookie with the token inside, sealed by the farm, which no script and no other site can use."""

import base64
import hashlib
import heapq
import hmac
import secrets
import time
from dataclasses import dataclass, field
from typing import Annotated
from urllib.parse import urlsplit

from cryptography.fernet import Fernet, InvalidToken
from fastapi import Depends, Form, Request, Response

from api_schemas.token import Scope
from services.api.door import SESSION_COOKIE as COOKIE
from services.api.farm import TheFarm
from services.errors import Forbidden, Unauthorised
from services.signing import FarmKey
from services.tokens import Caller

LASTS_S = 12 * 3600
"""After so long a browser has to show the token again."""


MOST_ENDED = 100_000
"""Signed-out sessions that are remembered one by one, in some 25 MB."""


@dataclass
class EndedSessions:
    """Hashes of cookies that were signed out, until they are too old anyhow; what the database has of them, and a copy of it.

    Of more than ``MOST_ENDED`` the oldest cookies are forgotten, and all that are no younger are over with them: one that was
    signed out never opens again.
    """

    _marks: set[bytes] = field(default_factory=set)
    _oldest: list[tuple[float, bytes]] = field(default_factory=list)
    """The same as a heap, with the times at which they are too old."""
    _over_until_s: float = 0.0

    def add(self, mark: bytes, until_s: float) -> None:
        """Remembers one."""
        if self.has(mark, until_s):
            return
        self._marks.add(mark)
        heapq.heappush(self._oldest, (until_s, mark))
        now_s = time.time()
        while self._oldest and (self._oldest[0][0] < now_s or len(self._oldest) > MOST_ENDED):
            self._over_until_s, old = heapq.heappop(self._oldest)
            self._marks.discard(old)

    def has(self, mark: bytes, until_s: float) -> bool:
        """Whether this cookie, too old at ``until_s`` anyhow, was signed out."""
        return until_s <= self._over_until_s or mark in self._marks


@dataclass(frozen=True)
class Seal:
    """Seals and opens cookies; kept is only which were signed out, so that the others outlive a restart."""

    secret: bytes
    ended: EndedSessions = field(default_factory=EndedSessions, repr=False)

    @classmethod
    def of(cls, key: FarmKey) -> "Seal":
        """The seal of a farm."""
        return cls(key.secret_for("dashboard sessions"))

    def close(self, bearer: str) -> str:
        """The cookie that stands for a token."""
        return self._fernet.encrypt(bearer.encode()).decode()

    def open(self, cookie: str) -> str | None:
        """The token inside a cookie; None when it is too old, signed out or none of ours."""
        try:
            bearer = self._fernet.decrypt(cookie.encode(), ttl=LASTS_S).decode()
        except InvalidToken:
            return None
        return None if self.ended.has(*self.mark(cookie)) else bearer

    def mark(self, cookie: str) -> tuple[bytes, float]:
        """What the farm knows this cookie, one of ours, by once it is signed out, and when it is too old anyhow."""
        return _mark(cookie), self._fernet.extract_timestamp(cookie.encode()) + LASTS_S

    def end(self, cookie: str) -> None:
        """From now on this cookie, one of ours, opens no more."""
        self.ended.add(*self.mark(cookie))

    def word(self, cookie: str) -> str:
        """What the forms of this session carry."""
        return hmac.new(self.secret, b"form " + cookie.encode(), hashlib.sha256).hexdigest()

    @property
    def _fernet(self) -> Fernet:
        return Fernet(base64.urlsafe_b64encode(self.secret))


def _mark(cookie: str) -> bytes:
    """Of the sealed bytes, not of the text: base64 has many texts for the same bytes, and each of them opens."""
    return hashlib.sha256(base64.urlsafe_b64decode(cookie.encode())).digest()


@dataclass(frozen=True)
class Session:
    """Who looks, the word that forms must carry, the token of the sign-in, and the cookie that stands for it."""

    caller: Caller
    csrf: str
    bearer: str = field(repr=False)
    cookie: str = field(repr=False)
    seal: Seal = field(repr=False)

    @property
    def lasts(self) -> bool:
        """Whether it was not signed out and is not too old; its token can have ended all the same."""
        return self.seal.open(self.cookie) is not None

    @property
    def mark(self) -> tuple[bytes, float]:
        """What other processes are to be told when it is signed out."""
        return self.seal.mark(self.cookie)

    def end(self) -> None:
        """Signs out here."""
        self.seal.end(self.cookie)


async def _seal(request: Request) -> Seal:
    return request.app.state.dashboard_seal


TheSeal = Annotated[Seal, Depends(_seal)]


async def session_of(request: Request, farm: TheFarm, seal: TheSeal) -> Session:
    """The session of a request.

    Raises:
        Unauthorised: it has none, or its token is over.
        Forbidden: its token may neither submit nor operate.
    """
    cookie = request.cookies.get(COOKIE)
    bearer = None if cookie is None else seal.open(cookie)
    if cookie is None or bearer is None:
        raise Unauthorised("session-missing", "Sign in with a token of the farm.")
    caller = await farm.tokens.caller(bearer)
    # For the limits and the audit line.
    request.state.caller, request.state.credential = caller, hashlib.sha256(cookie.encode()).hexdigest()
    if not caller.may(Scope.SUBMIT, Scope.OPERATE):
        raise Forbidden("scope-missing", f"The token of {caller.owner} may neither submit nor operate; this page is for those.")
    return Session(caller, seal.word(cookie), bearer, cookie, seal)


SignedIn = Annotated[Session, Depends(session_of)]


async def _changing(request: Request, session: SignedIn, csrf: Annotated[str, Form(max_length=100)] = "") -> Session:
    """The session of a request that changes something: only a form of our own pages may send it."""
    refuse_foreign(request)
    if not secrets.compare_digest(csrf.encode(), session.csrf.encode()):
        raise Forbidden("form-not-ours", "This form is older than the session, or was not made here; load the page again.")
    return session


def refuse_foreign(request: Request) -> None:
    """Refuses a form that another site has sent.

    Raises:
        Forbidden: the browser says that it was one, by where it fetches or by the form's origin.
    """
    said = request.headers.get("sec-fetch-site")
    if said is not None:  # what no page can forge, and no proxy before the farm changes
        if said not in {"same-origin", "none"}:
            raise Forbidden("form-not-ours", "This form was sent by another site; open this farm's own page.")
        return
    origin, host = request.headers.get("origin"), request.headers.get("host")
    if origin is not None and urlsplit(origin).netloc.lower() != (host or "").lower():
        raise Forbidden("form-not-ours", "This form was sent by another site's page; open this farm's own.")


Changing = Annotated[Session, Depends(_changing)]


async def _operating(session: Changing) -> Session:
    if not session.caller.may(Scope.OPERATE):
        raise Forbidden("scope-missing", f"This needs the scope operate; the token of {session.caller.owner} does not have it.")
    return session


Operating = Annotated[Session, Depends(_operating)]


def set_cookie(request: Request, response: Response, cookie: str) -> None:
    """Gives the browser its session: out of reach of scripts, not sent along by other sites."""
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, cookie, max_age=LASTS_S, httponly=True, samesite="lax", secure=secure)
