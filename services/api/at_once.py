"""How much an owner may have under way at once: counted before anything of its body is taken in, until it is answered."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from services.errors import TooMany
from services.tokens import Caller


@contextmanager
def one_more(under_way: Counter[str], caller: Caller, most: int, refusal: TooMany) -> Iterator[None]:
    """Counts one more of the caller's owner for as long as the block lasts; operators have no share and are not counted.

    Callers who leave before their answer are counted for as long as the work goes on.

    Args:
        under_way: how many each owner has; belongs to the event loop.
        caller: who asks.
        most: how many one owner may have.
        refusal: what is raised at the limit.

    Raises:
        TooMany: ``refusal``.
    """
    if caller.sees_only is None:
        yield
        return
    if under_way[caller.owner] >= most:
        raise refusal
    under_way[caller.owner] += 1
    try:
        yield
    finally:
        under_way[caller.owner] -= 1
        if not under_way[caller.owner]:
            del under_way[caller.owner]
