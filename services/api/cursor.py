"""Opaque cursors of lists that are ordered by a row's number."""

import base64
import binascii

from services.errors import Refused


def encode(number: int | None) -> str | None:
    """The cursor of the page after the row of this number."""
    return None if number is None else base64.urlsafe_b64encode(f"n{number}".encode()).decode().rstrip("=")


def decode(cursor: str | None, most: int = 10**18) -> int | None:
    """The number inside a cursor.

    Args:
        cursor: what was sent.
        most: the largest number that a row of this list can have.

    Raises:
        Refused: it is none that this API gave.
    """
    if cursor is None:
        return None
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode()
        if not (text[:1] == "n" and text[1:].isascii() and text[1:].isdigit() and len(text) <= 19 and int(text[1:]) <= most):
            raise ValueError(text)
        return int(text[1:])
    except (ValueError, binascii.Error) as error:
        raise Refused("bad-cursor", f"{cursor!r} is no cursor of this list; take next_cursor of the page before.") from error
