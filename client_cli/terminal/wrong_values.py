"""What a schema says of a wrong value, as a sentence about what the user wrote."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError  # which the help of a command does without

LONGEST_VALUE = 60
LIKE = 0.5
"""How like a name must be to what was written, from 0 to 1, to be what may have been meant."""
MOST_MEANT = 3
_OF_CHOICES = re.compile(r"^'(?P<given>.*)' is not one of (?P<choices>.*?)\.?$", re.DOTALL)


def meant(given: str, names: Iterable[str]) -> str:
    """A question after the name that may have been meant, such as "; did you mean push?"; nothing when none is like it.

    Names that have all words of what was written come before one that is only spelled like it.
    """
    words, known = _words(given), list(names)
    near = [name for name in known if words <= _words(name)][:MOST_MEANT] or get_close_matches(given.lower(), known, 1, LIKE)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _words(name: str) -> set[str]:
    return set(re.split(r"[-_.: ]+", name.lower()))


def with_meant(message: str) -> str:
    """A message of the command line's library about a choice, with what may have been meant."""
    found = _OF_CHOICES.match(message)
    if found is None:
        return message
    return message.rstrip(".") + meant(found["given"], re.findall(r"'([^']*)'", found["choices"]))


def sentence(error: "ValidationError", whole: str) -> str:
    """The first thing that is wrong, such as "trials is -1 and should be greater than or equal to 1".

    Args:
        error: of the schema.
        whole: the name of what was checked, for what is wrong with all of it.
    """
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    match first["type"]:
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            return f"{where} is not known there"
        case "value_error":
            reason = str(first.get("ctx", {}).get("error", first["msg"]))
            return f"{where}: {reason}" if where else reason
    _, should, wanted = first["msg"].partition(" should ")
    if not should:
        return f"{where or whole}: {first['msg']}"
    shown = repr(first["input"])
    shown = shown if len(shown) <= LONGEST_VALUE else shown[: LONGEST_VALUE - 1] + "…"
    return f"{where or whole} is {shown} and should {wanted}"
