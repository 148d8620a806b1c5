"""What a list is asked for, ``limit`` and ``cursor``: the same parameters and the same cursors on every list route."""

import base64
from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Query

from api_schemas.job import MAX_TRIALS
from services.database.pages import Asked, Key
from services.errors import Refused

LARGEST_NUMBER = 10**18
LONGEST_NAME = 40
_NUMBER, _NAME = "n", "s"


def numbered(*, usual: int, most: int, largest: int = LARGEST_NUMBER) -> Callable[..., Awaitable[Asked]]:
    """The parameters of a list that is ordered by a number, for ``Depends``.

    Args:
        usual: entries of a page where no limit is given.
        most: the largest limit.
        largest: the largest number that an entry of this list can have.
    """

    async def asked(cursor: str | None = None, limit: Annotated[int, Query(ge=1, le=most)] = usual) -> Asked:
        return Asked(limit, None if cursor is None else decode_number(cursor, largest))

    return asked


TRIALS_ON_A_PAGE = 1000
by_trial = numbered(usual=TRIALS_ON_A_PAGE, most=TRIALS_ON_A_PAGE, largest=MAX_TRIALS)
"""The parameters of a list of a job's trials."""


def named(*, usual: int, most: int) -> Callable[..., Awaitable[Asked]]:
    """The parameters of a list that is ordered by a name, for ``Depends``."""

    async def asked(cursor: str | None = None, limit: Annotated[int, Query(ge=1, le=most)] = usual) -> Asked:
        return Asked(limit, None if cursor is None else decode_name(cursor))

    return asked


def encode(key: Key | None) -> str | None:
    """The cursor of the page behind the entry of this key."""
    if key is None:
        return None
    text = f"{_NUMBER}{key}" if isinstance(key, int) else f"{_NAME}{key}"
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def decode_number(cursor: str, largest: int = LARGEST_NUMBER) -> int:
    """The number inside a cursor.

    Raises:
        Refused: it is none that this API gave for such a list.
    """
    digits = _decoded(cursor, _NUMBER)
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 18 and int(digits) <= largest):
        raise _refusal(cursor)
    return int(digits)


def decode_name(cursor: str) -> str:
    """The name inside a cursor.

    Raises:
        Refused: it is none that this API gave for such a list.
    """
    name = _decoded(cursor, _NAME)
    if not (0 < len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()):
        raise _refusal(cursor)
    return name


def _decoded(cursor: str, kind: str) -> str:
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode()
    except ValueError as error:
        raise _refusal(cursor) from error
    if text[:1] != kind:
        raise _refusal(cursor)
    return text[1:]


def _refusal(cursor: str) -> Refused:
    return Refused("bad-cursor", f"{cursor!r} is no cursor of this list; take next_cursor of the page before.")
