"""The database as the services use it: SQLite or PostgreSQL, chosen by its address alone; and migrations to the newest form."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, nullcontext
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import inspect, select, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DataError, DBAPIError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, create_async_engine

from services.database import postgres, sqlite
from services.errors import NotReady, Unavailable

MIGRATIONS = Path(__file__).parent.parent / "migrations"
AWAY = (DBAPIError, Unavailable)
"""What a statement may end with while the database is away: that broke in its midst, or found no way there."""
DATA_EXCEPTION = "22"
"""The class of SQLSTATE for values that do not fit (PostgreSQL, appendix A)."""
DISK_FULL_STATE = "53100"
ADDRESSES = "give postgresql://user:password@host/name, or none for SQLite in the data folder"


class Database:
    """Two engines on one database; owns all connections.

    SQLite lets one connection write at a time; waiting for it in this process is cheaper and fairer than SQLite's own
    busy loop, so writers queue on a lock. PostgreSQL lets many write, and every move of a job locks the job's row first.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.is_shared = not url.startswith("sqlite")
        """Whether other processes may write too."""
        if self.is_shared:
            self._readers, self._writer, self._singles = postgres.open_engines(url)
        else:
            self._readers, self._writer = sqlite.open_engines(url)
            self._singles = None
        self._brief_writer = self._writer.execution_options(lasting=False)
        self._turn: AbstractAsyncContextManager[object] = nullcontext() if self.is_shared else asyncio.Lock()

    @asynccontextmanager
    async def read(self) -> AsyncIterator[AsyncConnection]:
        """A connection for statements that change nothing; each sees what is committed when it runs."""
        async with _reached(self._readers) as connection:
            yield connection

    @asynccontextmanager
    async def write(self, *, lasting: bool = True) -> AsyncIterator[AsyncConnection]:
        """One transaction; committed when the block ends without an error.

        Args:
            lasting: wait until the disk has it. Without, a power cut (not a killed process) may take it back: for what
                a restart would find out anyway, such as that a robot answered.
        """
        writer = self._writer if lasting else self._brief_writer
        async with self._turn, _reached(writer) as connection, connection.begin():
            if self.is_shared and not lasting:
                await connection.execute(postgres.BRIEF)
            yield connection

    def single(self) -> AbstractAsyncContextManager[AsyncConnection]:
        """For one statement that changes what need not last; where many write it is a transaction of its own, without a begin."""
        return self.write(lasting=False) if self._singles is None else _reached(self._singles)

    async def check(self) -> None:
        """Asks the database for a number.

        Raises:
            Unavailable: it does not answer.
        """
        async with self.read() as connection:
            await connection.execute(select(1))

    async def close(self) -> None:
        """Closes all connections."""
        await self._readers.dispose()
        await self._writer.dispose()
        if self._singles is not None:
            await self._singles.dispose()


@asynccontextmanager
async def _reached(engine: AsyncEngine) -> AsyncIterator[AsyncConnection]:
    """A connection, or the error that the database is away; what goes wrong on the connection later is its user's."""
    connection = engine.connect()
    try:
        await connection.start()
    except postgres.AWAY as error:
        detail = "The database did not answer; nothing was changed by this request. Try again in a moment."
        raise Unavailable("database-unavailable", detail) from error
    try:
        yield connection
    finally:
        await connection.close()


def is_away(error: BaseException) -> bool:
    """Whether the database does nothing for anybody now: it is away, or its disk is full. Else the error is one statement's."""
    if isinstance(error, DBAPIError):
        return error.connection_invalidated or is_full_database(error)
    return isinstance(error, (Unavailable, OSError))


def is_full_database(error: DBAPIError) -> bool:
    """Whether the disk of the database is full."""
    return sqlite.is_full_sqlite(error) or getattr(error.orig, "sqlstate", None) == DISK_FULL_STATE


def is_of_value(error: DBAPIError) -> bool:
    """Whether the database, or its driver before it was asked, refused a value; asking again would not help."""
    sqlstate = getattr(error.orig, "sqlstate", None) or ""
    by_driver = error.orig is not None and isinstance(error.orig.__cause__, ValueError)
    return by_driver or isinstance(error, DataError) or sqlstate.startswith(DATA_EXCEPTION)


def address(url: str) -> str:
    """A database's address as people write it, with the driver that is used here.

    Raises:
        NotReady: it is neither SQLite nor PostgreSQL.
    """
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise NotReady(f"the database's address cannot be read; {ADDRESSES}") from error
    match parsed.get_backend_name():
        case "postgresql" | "postgres":
            return parsed.set(drivername=postgres.SCHEME).render_as_string(hide_password=False)
        case "sqlite":
            return parsed.set(drivername="sqlite+aiosqlite").render_as_string(hide_password=False)
        case other:
            raise NotReady(f"the database is {other}; {ADDRESSES}")


async def migrate(url: str, form: str = "head", *, back: bool = False) -> None:
    """Brings the database to the newest form, or to another one; creates it when there is none.

    Args:
        url: of the database.
        form: a revision.
        back: the form is an older one.

    Raises:
        NotReady: the database does not answer, or a newer version of the services has changed it.
    """
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.set_main_option("sqlalchemy.url", url.replace("%", "%%"))
    await _refuse_newer(url, config)
    await asyncio.to_thread(command.downgrade if back else command.upgrade, config, form)


async def form_of(url: str) -> str | None:
    """The revision that a database is in; None when it has no tables.

    Raises:
        NotReady: it does not answer, or is of too old a version.
    """
    engine, where = create_async_engine(url), make_url(url).render_as_string(hide_password=True)
    try:
        async with engine.connect() as connection:
            old = postgres.too_old(connection.dialect.server_version_info) if postgres.is_postgres(connection) else None
            if old is not None:
                raise NotReady(f"the database at {where} will not do: {old}")
            if not await connection.run_sync(lambda sync: inspect(sync).has_table("alembic_version")):
                return None
            return (await connection.execute(text("SELECT version_num FROM alembic_version"))).scalar_one_or_none()
    except postgres.AWAY as error:
        raise NotReady(f"the database at {where} cannot be opened ({error}); see that it runs and lets this user in") from error
    finally:
        await engine.dispose()


async def _refuse_newer(url: str, config: Config) -> None:
    form, scripts = await form_of(url), ScriptDirectory.from_config(config)
    if form is not None and form not in {script.revision for script in scripts.walk_revisions()}:
        newest = scripts.get_current_head()
        raise NotReady(
            f"the database has schema {form}; this version of the services knows schemas up to {newest}; start the version "
            "that upgraded it, or use a copy of the database from before. Nothing was changed"
        )
