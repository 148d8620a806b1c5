"""Bearer tokens: ``trifarm_<id>_<secret>``; only the SHA-256 of the whole token is stored."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import structlog
from sqlalchemy import Insert, bindparam, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from api_schemas.token import NewToken, Scope, Token, TokenRequest
from services.database.database import AWAY, Database
from services.database.pages import Asked, Page, read_page
from services.database.rows import AnyRow
from services.database.tables import token
from services.errors import Forbidden, NotFound, Refused, Unauthorised
from services.jobs.clock import FarmClock, iso

log = structlog.get_logger()
PREFIX = "trifarm"
FORM = re.compile(rf"{PREFIX}_([A-Za-z0-9.@-]{{1,20}})_(.+)")
REMEMBERED_S = 0.3
"""How long a checked token is trusted without asking the database: the longest that a revoked one still works elsewhere."""
LAST_USED_EVERY_S = 60.0
DAY_S = 86_400.0
_PARENT = token.alias("parent")
_WITH_PARENT = select(
    token, _PARENT.c.revoked_at.label("parent_revoked_at"), _PARENT.c.expires_at.label("parent_expires_at")
).select_from(token.outerjoin(_PARENT, _PARENT.c.token_id == token.c.parent))
_OF_ID = _WITH_PARENT.where(token.c.token_id == bindparam("of_id"))


@dataclass(frozen=True)
class Caller:
    """Who asks, and with which scopes; ``robot`` is the one that the token speaks for, ``key`` the SHA-256 of the token."""

    token_id: str
    owner: str
    scopes: frozenset[Scope]
    robot: str | None = None
    key: str = ""

    def may(self, *any_of: Scope) -> bool:
        """Whether the caller has one of the scopes, or admin."""
        return Scope.ADMIN in self.scopes or not self.scopes.isdisjoint(any_of)

    @property
    def sees_only(self) -> str | None:
        """The owner whose jobs alone the caller may see; None for those who may see all."""
        return None if self.may(Scope.OPERATE) else self.owner


@dataclass
class Tokens:
    """The tokens of the farm; truth is the database, remembered for a moment because robots ask often."""

    database: Database
    clock: FarmClock
    _remembered: dict[str, tuple[Caller, float]] = field(default_factory=dict)
    _used_s: dict[str, float] = field(default_factory=dict)
    _times_forgotten: int = 0

    async def caller(self, bearer: str) -> Caller:
        """Who this token stands for.

        Raises:
            Unauthorised: it is unknown, revoked or expired.
        """
        return await self._known(sha256(bearer), _id(bearer))

    async def still_holds(self, caller: Caller) -> bool:
        """Whether the token of a caller who is being served is still valid."""
        try:
            await self._known(caller.key, caller.token_id)
        except Unauthorised:
            return False
        return True

    async def lasts(self, token_id: str, until_s: float) -> bool:
        """Whether a token of this id is valid now, for who has something that was made with it and ends at a time anyhow."""
        if self.clock.now_s() >= until_s:
            return False
        async with self.database.read() as connection:
            row = (await connection.execute(_OF_ID, {"of_id": token_id})).one_or_none()
        try:
            self._check(row, "" if row is None else row.secret_sha256, self.clock.now_s())
        except Unauthorised:
            return False
        return True

    async def _known(self, hashed: str, token_id: str) -> Caller:
        now_s = self.clock.now_s()
        if (known := self._remembered.get(hashed)) is not None and now_s < known[1] <= now_s + REMEMBERED_S:
            return known[0]
        before = self._times_forgotten
        async with self.database.read() as connection:
            row = (await connection.execute(_OF_ID, {"of_id": token_id})).one_or_none()
        self._check(row, hashed, now_s)
        assert row is not None, "_check refuses a missing row"
        caller = Caller(row.token_id, row.owner, frozenset(Scope(scope) for scope in row.scopes.split()), row.robot, hashed)
        await self._used(row.token_id, now_s)
        self._remembered = {each: kept for each, kept in self._remembered.items() if now_s < kept[1]}
        if before == self._times_forgotten:  # else it may have been read before what was changed meanwhile
            self._remembered[hashed] = (caller, now_s + REMEMBERED_S)
        return caller

    def _forget(self) -> None:
        """A token has changed: what is known of any, or is being read now, is not kept."""
        self._remembered.clear()
        self._times_forgotten += 1

    @staticmethod
    def _check(row: AnyRow | None, hashed: str, now_s: float) -> None:
        if row is None or not hmac.compare_digest(row.secret_sha256, hashed):
            raise Unauthorised("token-unknown", "This token is not known here; ask the farm's operator for one.")
        for revoked_at in (row.revoked_at, row.parent_revoked_at):
            if revoked_at is not None:
                raise Unauthorised(
                    "token-revoked", f"This token was revoked at {revoked_at}; ask for a new one.", token_id=row.token_id
                )
        for expires_at in (row.expires_at, row.parent_expires_at):
            if expires_at is not None and expires_at <= iso(now_s):
                raise Unauthorised(
                    "token-expired", f"This token expired at {expires_at}; ask for a new one.", token_id=row.token_id
                )

    async def _used(self, token_id: str, now_s: float) -> None:
        if now_s - self._used_s.get(token_id, 0.0) < LAST_USED_EVERY_S:
            return
        self._used_s[token_id] = now_s
        with suppress(*AWAY):  # on a full disk whoever only reads is answered all the same
            async with self.database.single() as connection:
                await connection.execute(update(token).where(token.c.token_id == token_id).values(last_used_at=iso(now_s)))

    async def make(self, request: TokenRequest) -> NewToken:
        """A new token; its secret is in the answer and nowhere else."""
        bearer = new_bearer()
        row = await self._insert(bearer, request)
        return NewToken(**_shown(row).model_dump(), secret=bearer)

    async def of_robot(self, caller: Caller, bearer: str, robot: str) -> NewToken:
        """The token of one robot, derived from the one that the caller shows: the same however often it is asked for.

        It ends with the one that it was derived from. Whoever shows a robot's own token gets that.

        Raises:
            Forbidden: the token is another robot's.
            Unauthorised: the robot's token was revoked.
        """
        if caller.robot not in (None, robot):
            raise Forbidden(
                "token-of-another-robot", f"The token is of {caller.robot}, not of {robot}; it can join as itself only."
            )
        if caller.robot is None:
            bearer = derived(caller.token_id, bearer, robot)
        row = await self._row_of(bearer)
        if row is None:
            request = TokenRequest(owner=caller.owner, scopes=(Scope.ROBOT,))
            with suppress(IntegrityError):  # it asked twice at the same time
                row = await self._insert(bearer, request, robot=robot, parent=caller.token_id)
        if row is None or row.revoked_at is not None:
            await self.caller(bearer)
            row = await self._row_of(bearer)
        assert row is not None, "a token that is good has a row"
        return NewToken(**_shown(row).model_dump(), secret=bearer)

    async def _row_of(self, bearer: str) -> AnyRow | None:
        async with self.database.read() as connection:
            return (await connection.execute(select(token).where(token.c.token_id == _id(bearer)))).one_or_none()

    async def register(self, bearer: str, request: TokenRequest) -> None:
        """Makes a token that was given from outside valid, whatever is known under its id; again changes nothing.

        Who starts the services and names a token means this one: its secret and scopes win over stored ones, and it is
        valid again if it was revoked.

        Raises:
            Refused: it does not have the form of a token.
        """
        if not _id(bearer):
            raise Refused(
                "token-malformed",
                f"A token must read {PREFIX}_<id>_<secret>, the id 1 to 20 of A-Z a-z 0-9 . @ -; the given one does not.",
            )
        async with self.database.read() as connection:
            known = (await connection.execute(select(token).where(token.c.token_id == _id(bearer)))).one_or_none()
        if known is None:
            await self._insert(bearer, request)
            return
        wanted = {
            "owner": request.owner,
            "secret_sha256": sha256(bearer),
            "scopes": _words(request),
            "revoked_at": None,
            "expires_at": None,
        }
        changed = sorted(name for name, value in wanted.items() if getattr(known, name) != value)
        if changed:
            async with self.database.write() as tx:
                await tx.execute(update(token).where(token.c.token_id == known.token_id).values(**wanted))
                await tx.execute(delete(token).where(token.c.parent == known.token_id))
            self._forget()
            log.info("stored token replaced by the given one", token_id=known.token_id, changed=changed)

    async def keep(self, made: Mapping[str, TokenRequest]) -> None:
        """Makes new tokens valid, all of them or none."""
        async with self.database.write() as tx:
            for bearer, request in made.items():
                await tx.execute(self._row(bearer, request))

    async def _insert(self, bearer: str, request: TokenRequest, *, robot: str | None = None, parent: str | None = None) -> AnyRow:
        async with self.database.write() as tx:
            return (await tx.execute(self._row(bearer, request, robot, parent).returning(*token.c))).one()

    def _row(self, bearer: str, request: TokenRequest, robot: str | None = None, parent: str | None = None) -> Insert:
        now_s, days = self.clock.now_s(), request.expires_in_days
        return insert(token).values(
            token_id=_id(bearer),
            owner=request.owner,
            scopes=_words(request),
            secret_sha256=sha256(bearer),
            created_at=iso(now_s),
            expires_at=None if days is None else iso(now_s + days * DAY_S),
            robot=robot,
            parent=parent,
        )

    async def any(self) -> bool:
        """Whether a token was ever made."""
        async with self.database.read() as connection:
            return (await connection.execute(select(token.c.token_id).limit(1))).first() is not None

    async def page(self, asked: Asked) -> Page[Token]:
        """Tokens without secrets, those that have ended included, by id."""
        async with self.database.read() as connection:
            page = await read_page(connection, select(token), token.c.token_id, asked, newest_first=False)
        return page.show(_shown)

    async def revoke(self, token_id: str) -> None:
        """Ends a token, at once in this process.

        Raises:
            NotFound: there is no such token.
        """
        ended = update(token).where(token.c.token_id == token_id, token.c.revoked_at.is_(None))
        async with self.database.write() as tx:
            changed = await tx.execute(ended.values(revoked_at=self.clock.now_iso()))
            known = (await tx.execute(select(token.c.token_id).where(token.c.token_id == token_id))).first()
        if changed.rowcount == 0 and known is None:
            raise NotFound("token-not-found", f"There is no token {token_id}; GET /v1/tokens lists them.")
        self._forget()


def new_bearer() -> str:
    """The text of a token that nobody has yet."""
    return f"{PREFIX}_{secrets.token_hex(4)}_{secrets.token_urlsafe(32)}"


def sha256(bearer: str) -> str:
    """What is stored of a token. A plain hash is enough: the secret has 256 random bits."""
    return hashlib.sha256(bearer.encode()).hexdigest()


def derived(parent_id: str, parent: str, robot: str) -> str:
    """The token of a robot, which nobody can make who does not have the one that it is made of."""
    number = hashlib.sha256(f"{parent_id} {robot}".encode()).hexdigest()[:16]
    return f"{PREFIX}_{number}_{hmac.new(parent.encode(), f'robot {robot}'.encode(), hashlib.sha256).hexdigest()}"


def _id(bearer: str) -> str:
    found = FORM.fullmatch(bearer)
    return "" if found is None else found[1]


def _words(request: TokenRequest) -> str:
    return " ".join(sorted(set(request.scopes)))


def _shown(row: AnyRow) -> Token:
    return Token(
        token_id=row.token_id,
        owner=row.owner,
        scopes=tuple(Scope(scope) for scope in row.scopes.split()),
        created_at=row.created_at,
        expires_at=row.expires_at,
        last_used_at=row.last_used_at,
        revoked_at=row.revoked_at,
        robot=row.robot,
    )
