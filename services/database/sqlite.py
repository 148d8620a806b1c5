"""SQLite as the home of truth: one writer whose statements run on the event loop, and readers beside it."""

import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import aiosqlite
from sqlalchemy import event
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

READERS = 4
BUSY_TIMEOUT_S = 10.0
SYNCHRONOUS = "synchronous"
"""Under which a connection remembers how it syncs."""


def open_engines(url: str) -> tuple[AsyncEngine, AsyncEngine]:
    """The engine of the readers and that of the one writer."""
    reading, writing = (partial(_connected, kind, url) for kind in (ReadingConnection, NearConnection))
    many = {"pool_size": READERS, "max_overflow": READERS}
    # What reads leaves nothing behind that would have to be taken back.
    readers = create_async_engine(url, isolation_level="AUTOCOMMIT", async_creator=reading, pool_reset_on_return=None, **many)
    writer = create_async_engine(url, pool_size=1, max_overflow=0, async_creator=writing)
    _begin_at_once(writer)
    return readers, writer


class NearConnection(aiosqlite.Connection):
    """A connection that goes to its thread only for what can wait on the disk or on a lock.

    A statement of the writer takes SQLite some 20 µs, the way to a thread and back four times as much, and SQLAlchemy goes
    it four times a statement. Only BEGIN (the lock) and COMMIT (the disk) are worth it.
    """

    async def _execute(self, function: Callable[..., Any], *args: Any, **more: Any) -> Any:
        waits = function.__name__ in {"commit", "close"} or (args and isinstance(args[0], str) and args[0].startswith("BEGIN"))
        if waits or self._connection is None:
            return await super()._execute(function, *args, **more)
        return function(*args, **more)


class ReadingConnection(aiosqlite.Connection):
    """A connection that goes to its thread once for a statement and its rows together; SQLAlchemy asks for these in four ways."""

    _rows: Sequence[Any] = ()

    async def _execute(self, function: Callable[..., Any], *args: Any, **more: Any) -> Any:
        cursor = getattr(function, "__self__", None)
        if self._connection is None or not isinstance(cursor, (sqlite3.Cursor, sqlite3.Connection)):
            return await super()._execute(function, *args, **more)
        if function.__name__ == "execute":
            self._rows = await super()._execute(_read, cursor, *args)
            return cursor
        if function.__name__ == "fetchall":
            return self._rows
        is_quick = function.__name__ == "cursor" or (function.__name__ == "close" and isinstance(cursor, sqlite3.Cursor))
        return function(*args, **more) if is_quick else await super()._execute(function, *args, **more)


def _read(cursor: sqlite3.Cursor, *statement: Any) -> Sequence[Any]:
    cursor.execute(*statement)
    return cursor.fetchall() if cursor.description else ()


async def _connected(kind: type[aiosqlite.Connection], url: str) -> aiosqlite.Connection:
    connection = kind(partial(_opened, url.partition("///")[2]), iter_chunk_size=64)
    # One that is still out when all others are closed, as of a request that was broken off, must not keep the process.
    connection._thread.daemon = True
    return await connection


def _opened(path: str) -> sqlite3.Connection:
    # The driver would start transactions late and deferred; the "begin" event does it instead.
    connection = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA foreign_keys = ON")
    return connection


def _begin_at_once(writer: AsyncEngine) -> None:
    @event.listens_for(writer.sync_engine, "begin")
    def _begin(connection: Any) -> None:
        # FULL syncs the log at every commit: with NORMAL a power cut could take back an acknowledged submission.
        wanted = "FULL" if connection.get_execution_options().get("lasting", True) else "NORMAL"
        if connection.info.get(SYNCHRONOUS) != wanted:
            connection.exec_driver_sql(f"PRAGMA synchronous = {wanted}")
            connection.info[SYNCHRONOUS] = wanted
        connection.exec_driver_sql("BEGIN IMMEDIATE")


def is_full_sqlite(error: BaseException) -> bool:
    """Whether SQLite, through whoever called it, says that its disk is full."""
    said = getattr(error, "orig", error)
    return getattr(said, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL


def integrity_check(path: Path) -> str:
    """SQLite's own verdict on a database file; ``ok`` when it is whole.

    Raises:
        sqlite3.OperationalError: it is in use, or cannot be read.
    """
    with closing(sqlite3.connect(path)) as connection:
        try:
            return str(connection.execute("PRAGMA integrity_check").fetchone()[0])
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError as error:  # so damaged that it cannot be looked through
            return str(error)
