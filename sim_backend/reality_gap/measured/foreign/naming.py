"""How a message names what would have been valid."""

import difflib
from collections.abc import Iterable, Sequence


def nearest(name: str, valid: Iterable[str]) -> str:
    """`` (did you mean 'x'?)`` if a valid name is near, otherwise nothing."""
    found = difflib.get_close_matches(name, list(valid), n=1, cutoff=0.6)
    return f" (did you mean {found[0]!r}?)" if found else ""


def listed(names: Sequence[str], most: int = 40) -> str:
    """Names in a sentence, at most so many."""
    if not names:
        return "none"
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest
