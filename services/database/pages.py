"""One kind of page for all lists: rows in the order of a unique key, from the row after a given one on.

The key is looked up in its index, so that the fiftieth page costs what the first costs, and a row that is added or removed
meanwhile moves no other from one page to the next.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from sqlalchemy import ColumnElement
from sqlalchemy.ext.asyncio import AsyncConnection

from services.database.rows import AnyRow, AnySelect

Key: TypeAlias = int | str
Entry = TypeVar("Entry")
Shown = TypeVar("Shown")


@dataclass(frozen=True)
class Asked:
    """At most ``limit`` entries of a list, those behind the key ``after``; None begins with the first."""

    limit: int
    after: Key | None = None


@dataclass(frozen=True)
class Page(Generic[Entry]):
    """Entries, and the key after which the next page begins; None on the last page."""

    entries: Sequence[Entry]
    following: Key | None

    def show(self, shown: Callable[[Entry], Shown]) -> "Page[Shown]":
        """The same page with its entries in another form."""
        return Page([shown(entry) for entry in self.entries], self.following)


async def read_page(
    connection: AsyncConnection, wanted: AnySelect, key: ColumnElement[Any], asked: Asked, *, newest_first: bool = True
) -> Page[AnyRow]:
    """Reads a page of the rows that ``wanted`` selects.

    Args:
        connection: where they are.
        wanted: the statement, without order and limit.
        key: a unique column; with ``newest_first`` the largest comes first.
        asked: which page.
        newest_first: whether the order is descending.
    """
    if asked.after is not None:
        wanted = wanted.where(key < asked.after if newest_first else key > asked.after)
    in_order = wanted.add_columns(key.label("page_key")).order_by(key.desc() if newest_first else key)
    rows = (await connection.execute(in_order.limit(asked.limit + 1))).all()
    return _cut(rows, asked, lambda row: row.page_key)


def page_of(entries: Sequence[Entry], key: Callable[[Entry], str], asked: Asked) -> Page[Entry]:
    """A page of a list in memory, in ascending order of a name."""
    ordered = sorted(entries, key=key)
    return _cut([entry for entry in ordered if asked.after is None or key(entry) > str(asked.after)], asked, key)


def _cut(entries: Sequence[Entry], asked: Asked, key: Callable[[Entry], Key]) -> Page[Entry]:
    following = key(entries[asked.limit - 1]) if len(entries) > asked.limit else None
    return Page(entries[: asked.limit], following)
