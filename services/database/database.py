"""The database as the services use it: readers beside one writer, and migrations to the newest form."""

import asyncio
import sqlite3
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiosqlite
from alembic import command
from alembic.config import Config
from sqlalchemy import event
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, create_async_engine

MIGRATIONS = Path(__file__).parent.parent / "migrations"
READERS = 4
BUSY_TIMEOUT_MS = 10_000


class Database:
    """Two engines on one database; owns all connections.

    SQLite lets one connection write at a time; waiting for it in this process is cheaper and fairer than SQLite's own
    busy loop, so writers queue on a lock.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._readers = create_async_engine(url, isolation_level="AUTOCOMMIT", pool_size=READERS, max_overflow=READERS)
        near = {"async_creator": lambda: _near_connection(url)} if url.startswith("sqlite") else {}
        self._writer = create_async_engine(url, pool_size=1, max_overflow=0, **near)
        self._brief_writer = self._writer.execution_options(lasting=False)
        self._one_writer = asyncio.Lock()
        if self._writer.dialect.name == "sqlite":
            _prepare_sqlite(self._readers, writes=False)
            _prepare_sqlite(self._writer, writes=True)

    @asynccontextmanager
    async def read(self) -> AsyncIterator[AsyncConnection]:
        """A connection for statements that change nothing; each sees what is committed when it runs."""
        async with self._readers.connect() as connection:
            yield connection

    @asynccontextmanager
    async def write(self, *, lasting: bool = True) -> AsyncIterator[AsyncConnection]:
        """One transaction; committed when the block ends without an error.

        Args:
            lasting: wait until the disk has it. Without, a power cut (not a killed process) may take it back: for what
                a restart would find out anyway, such as that a robot answered.
        """
        writer = self._writer if lasting else self._brief_writer
        async with self._one_writer, writer.begin() as connection:
            yield connection

    async def close(self) -> None:
        """Closes all connections."""
        await self._readers.dispose()
        await self._writer.dispose()


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


async def _near_connection(url: str) -> aiosqlite.Connection:
    path = url.partition("///")[2]
    connection = NearConnection(lambda: sqlite3.connect(path, check_same_thread=False), iter_chunk_size=64)
    return await connection


def _prepare_sqlite(engine: AsyncEngine, *, writes: bool) -> None:
    @event.listens_for(engine.sync_engine, "connect")
    def _pragmas(connection: Any, _record: Any) -> None:
        cursor = connection.cursor()
        cursor.execute("PRAGMA journal_mode = WAL")
        cursor.execute("PRAGMA foreign_keys = ON")
        cursor.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
        cursor.close()
        # The driver would start transactions late and deferred; the "begin" event below does it instead.
        connection.isolation_level = None

    if writes:

        @event.listens_for(engine.sync_engine, "begin")
        def _begin(connection: Any) -> None:
            # FULL syncs the log at every commit: with NORMAL a power cut could take back an acknowledged submission.
            lasting = connection.get_execution_options().get("lasting", True)
            connection.exec_driver_sql(f"PRAGMA synchronous = {'FULL' if lasting else 'NORMAL'}")
            connection.exec_driver_sql("BEGIN IMMEDIATE")


async def migrate(url: str, form: str = "head", *, back: bool = False) -> None:
    """Brings the database to the newest form, or to another one; creates it when there is none.

    Args:
        url: of the database.
        form: a revision.
        back: the form is an older one.
    """
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.set_main_option("sqlalchemy.url", url.replace("%", "%%"))
    await asyncio.to_thread(command.downgrade if back else command.upgrade, config, form)


def integrity_check(path: Path) -> str:
    """SQLite's own verdict on a database file; ``ok`` when it is whole."""
    with sqlite3.connect(path) as connection:
        return str(connection.execute("PRAGMA integrity_check").fetchone()[0])
