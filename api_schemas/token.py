"""Bearer tokens: opaque, scoped, shown once and stored only as a hash."""

from enum import StrEnum

from pydantic import Field

from api_schemas.schema import Schema

MAX_DAYS = 36_500
"""A token that is to live for a hundred years may as well not expire."""


class Scope(StrEnum):
    """What a token may do; ``admin`` may do everything."""

    SUBMIT = "submit"
    OPERATE = "operate"
    ROBOT = "robot"
    ADMIN = "admin"


class TokenRequest(Schema):
    """Body of POST /v1/tokens."""

    owner: str = Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9._@-]+$")
    scopes: tuple[Scope, ...] = Field(min_length=1)
    expires_in_days: float | None = Field(default=None, gt=0, le=MAX_DAYS)


class Token(Schema):
    """A token without its secret; one with a ``robot`` speaks for this robot alone."""

    token_id: str
    owner: str
    scopes: tuple[Scope, ...]
    created_at: str
    expires_at: str | None
    last_used_at: str | None
    revoked_at: str | None
    robot: str | None = None


class NewToken(Token):
    """A token just made; ``secret`` is the whole bearer token and is never shown again."""

    secret: str


class TokenPage(Schema):
    """One page of tokens, by id; ``next_cursor`` is null on the last page."""

    tokens: tuple[Token, ...]
    next_cursor: str | None = None
