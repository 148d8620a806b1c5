"""PostgreSQL as the home of truth: many writers, none of whom can hold the others up for long."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import asyncpg
from sqlalchemy import ColumnElement, event, func, select, text
from sqlalchemy.exc import DisconnectionError, InvalidatePoolError, SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, create_async_engine

SCHEME = "postgresql+asyncpg"
READERS, WRITERS, SINGLES = 12, 16, 16
"""Connections that each pool opens at most, and keeps: to open one costs the server a process and both sides milliseconds."""
CONNECT_WITHIN_S = 5
HELD_AT_MOST_MS = 10_000
"""A transaction whose process was stopped or cut off in the middle is taken back after so long, and its locks are free."""
STATEMENT_MS = 60_000
SESSION = {
    "application_name": "trifarm",
    "jit": "off",
    "timezone": "UTC",
    "idle_in_transaction_session_timeout": str(HELD_AT_MOST_MS),
    "lock_timeout": str(2 * HELD_AT_MOST_MS),
    "statement_timeout": str(STATEMENT_MS),
    "tcp_keepalives_idle": "5",
    "tcp_keepalives_interval": "2",
    "tcp_keepalives_count": "3",
}
SINGLE = {"synchronous_commit": "off", "lock_timeout": "2000"}
"""Beside that, of sessions for one statement each: what it changes need not last, and it must not keep the next ones waiting."""
OLDEST = 15
"""The oldest major version of the server that all statements have been tried on."""
AWAY = (OSError, SQLAlchemyError, asyncpg.PostgresError, asyncpg.InterfaceError)
"""What the way to a server that is stopped, starting, full or cut off may end with."""
MIGRATING = 0x7472_6966_0001
DISPATCHING = 0x7472_6966_0002
RESTED_S = 1.0
USED_S = "used_s"
"""Under which a connection's record remembers when it was given back."""
BRIEF = text("SET LOCAL synchronous_commit TO OFF")


def open_engines(url: str) -> tuple[AsyncEngine, AsyncEngine, AsyncEngine]:
    """The engines of readers, of writers and of single statements; apart, so that none of them waits for another."""
    readers, singles = _engine(url, SESSION, READERS), _engine(url, SESSION | SINGLE, SINGLES)
    alone = {"isolation_level": "AUTOCOMMIT"}
    return readers.execution_options(**alone), _engine(url, SESSION, WRITERS), singles.execution_options(**alone)


def _engine(url: str, session: Mapping[str, str], connections: int) -> AsyncEngine:
    how = {"timeout": CONNECT_WITHIN_S, "command_timeout": STATEMENT_MS / 1000, "server_settings": session}
    # The one that was used last comes next, so that under little load few are asked whether they still live.
    engine = create_async_engine(url, pool_size=connections, max_overflow=0, pool_use_lifo=True, connect_args=how)
    event.listen(engine.sync_engine, "checkin", _note_use)
    event.listen(engine.sync_engine, "checkout", _look_before_use)
    return engine


def _note_use(_connection: Any, record: Any) -> None:
    record.info[USED_S] = time.monotonic()


def _look_before_use(connection: Any, record: Any, _proxy: Any) -> None:
    """A connection that a restart of the server has cut is found out before it is used.

    The server says so when it ends. What says nothing, such as a cable, is asked after where nobody used the connection for a
    moment: to ask each time, as the pool would, takes a transaction of its own, three ways to the server.
    """
    if connection.driver_connection.is_closed():
        raise DisconnectionError
    if time.monotonic() - record.info.get(USED_S, time.monotonic()) > RESTED_S:
        try:
            connection.ping()
        except (*AWAY, connection.dbapi.Error) as error:
            raise InvalidatePoolError from error  # the others will be as dead


def too_old(version: Sequence[int | str] | None) -> str | None:
    """Why a server of this version will not do; None if it will."""
    if version is None or int(version[0]) >= OLDEST:
        return None
    return f"it is PostgreSQL {'.'.join(map(str, version))}, and the farm needs {OLDEST} or newer; update the server"


def is_postgres(connection: AsyncConnection) -> bool:
    """Whether several processes may write at the same time."""
    return connection.dialect.name == "postgresql"


async def dispatch_alone(tx: AsyncConnection) -> None:
    """Waits until no other dispatcher is in a transaction that looks for trials; holds until this one ends."""
    if is_postgres(tx):
        await tx.execute(select(func.pg_advisory_xact_lock(DISPATCHING)))


def server_clock_s() -> ColumnElement[Any]:
    """The clock of the database's host, in seconds since 1970."""
    return func.extract("epoch", func.clock_timestamp())
