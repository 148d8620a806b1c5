"""Runs the revisions on the database that the configuration names."""

import asyncio
from typing import Any

from alembic import context
from sqlalchemy import Connection, event, func, pool, select
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from services.database.postgres import MIGRATING
from services.database.tables import metadata


def _run(connection: Connection) -> None:
    # SQLite can take back changes of tables like any other, though Alembic does not count on it.
    if connection.dialect.name == "postgresql":
        # Services that start at the same time take turns; the second finds nothing left to do.
        connection.execute(select(func.pg_advisory_xact_lock(MIGRATING)))
    context.configure(connection=connection, target_metadata=metadata, render_as_batch=True, transactional_ddl=True)
    with context.begin_transaction():
        context.run_migrations()


def _begin_for_real(engine: AsyncEngine) -> None:
    """Makes SQLite's driver leave transactions alone: it begins none before it changes a table.

    Without, a process that is killed in the middle leaves a form that is neither the old nor the new one.
    """

    @event.listens_for(engine.sync_engine, "connect")
    def _leave_alone(connection: Any, _record: Any) -> None:
        connection.isolation_level = None

    @event.listens_for(engine.sync_engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql("BEGIN IMMEDIATE")


async def _online() -> None:
    url = context.config.get_main_option("sqlalchemy.url")
    assert url, "the database's address is set by services.database.database.migrate"
    engine = create_async_engine(url, poolclass=pool.NullPool)
    if engine.dialect.name == "sqlite":
        _begin_for_real(engine)
    async with engine.connect() as connection:
        await connection.run_sync(_run)
        await connection.commit()
    await engine.dispose()


asyncio.run(_online())
