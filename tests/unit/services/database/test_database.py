import asyncio

import pytest
from sqlalchemy import insert, inspect, select, text

from services.database.database import Database, integrity_check, migrate
from services.database.tables import metadata, token

ROW = {"token_id": "a", "owner": "o", "scopes": "admin", "secret_sha256": "0" * 64, "created_at": "now"}


@pytest.fixture
async def database(tmp_path):
    url = f"sqlite+aiosqlite:///{tmp_path / 'farm.sqlite'}"
    await migrate(url)
    opened = Database(url)
    yield opened
    await opened.close()


async def test_migrations_make_exactly_the_tables_that_the_code_uses(database):
    def shape(connection):
        found = inspect(connection)
        tables = {name: {each["name"]: each["nullable"] for each in found.get_columns(name)} for name in found.get_table_names()}
        indexes = {name: {each["name"] for each in found.get_indexes(name)} for name in tables}
        return tables, indexes

    async with database.read() as connection:
        tables, indexes = await connection.run_sync(shape)
    tables.pop("alembic_version")
    assert tables == {t.name: {c.name: c.nullable for c in t.columns} for t in metadata.sorted_tables}
    for table in metadata.sorted_tables:
        assert indexes[table.name] == {index.name for index in table.indexes}


async def test_migrating_twice_changes_nothing(database):
    await migrate(database.url)


async def test_an_acknowledged_commit_is_synced_to_disk(database):
    async with database.write() as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 2
        assert (await tx.execute(text("PRAGMA journal_mode"))).scalar() == "wal"
        assert (await tx.execute(text("PRAGMA foreign_keys"))).scalar() == 1
    async with database.write(lasting=False) as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 1
    async with database.write() as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 2


async def test_an_error_takes_the_whole_transaction_back(database):
    with pytest.raises(ZeroDivisionError):
        async with database.write() as tx:
            await tx.execute(insert(token).values(ROW))
            raise ZeroDivisionError
    async with database.read() as connection:
        assert (await connection.execute(select(token))).all() == []


async def test_writers_take_turns_and_readers_see_only_what_is_committed(database):
    async def write(name):
        async with database.write() as tx:
            await tx.execute(insert(token).values(ROW | {"token_id": name}))
            async with database.read() as connection:
                seen = (await connection.execute(select(token.c.token_id))).scalars().all()
            assert name not in seen
            await asyncio.sleep(0)

    await asyncio.gather(*(write(str(number)) for number in range(20)))
    async with database.read() as connection:
        assert len((await connection.execute(select(token))).all()) == 20


async def test_integrity(database, tmp_path):
    assert integrity_check(tmp_path / "farm.sqlite") == "ok"
