"""On each home: from nothing and from every released form to the newest and back, with what was in it."""

import asyncio
import sys

import pytest
from alembic.script import ScriptDirectory
from sqlalchemy import MetaData, insert, inspect, select, text

from services.database.database import MIGRATIONS, Database, address, form_of, migrate
from services.database.tables import metadata
from services.errors import NotReady

D = "d" * 64
POLICY = {"number": 1, "digest": D, "name": "p", "weights_format": "onnx", "weights_sha256": D, "weights_bytes": 1}
POLICY |= {"graph_sha256": D, "manifest": "{}", "warnings": "[]", "owner": "ann", "created_at": "now"}
JOB = {"number": 1, "job_id": "j1", "state": "running", "policy": D, "policy_name": "p", "task": "push", "trials": 2, "seed": 5}
JOB |= {"seed_drawn_by_server": False, "owner": "ann", "created_at": "now", "created_s": 0.5, "cancel_requested": False}
JOB |= {"trials_done": 1, "trials_active": 1, "successes": 1, "policy_faults": 0, "platform_faults": 0, "last_event": 1}
TRIAL = {"trial_id": "j1-000", "job_number": 1, "ordinal": 0, "state": "running", "seed": 7, "robot_order": "[]", "fence": 2}
TRIAL |= {"robot": "robot-0", "lease_until_s": 9.5, "faults": 1}
DONE = TRIAL | {"trial_id": "j1-001", "ordinal": 1, "state": "done", "lease_until_s": None, "fence": 1, "faults": 0}
ATTEMPT = {"trial_id": "j1-001", "fence": 1, "job_number": 1, "robot": "robot-0", "state": "accepted", "started_at": "now"}
EVENT = {"job_number": 1, "id": 1, "at": "now", "kind": "job_queued", "text": "queued", "trials_done": 0, "successes": 0}
ROWS = {"policy": [POLICY], "robot": [{"robot": "robot-0", "drain": False, "first_seen_at": "now"}], "job": [JOB]}
ROWS |= {"trial": [TRIAL, DONE], "attempt": [ATTEMPT], "event": [EVENT | {"state": "queued"}]}
ROWS |= {"report": [{"job_number": 1, "body": b"{}", "sha256": D, "created_at": "now"}]}
LATER = {"trial": {"owner": "ann"}, "robot": {"trials_done": 1}}
"""What rows hold besides in the forms that have the columns; when these come, older rows get the same."""
RELEASED = sorted(script.revision for script in ScriptDirectory(str(MIGRATIONS)).walk_revisions())
ENDS = (RELEASED[0], *RELEASED[-3:])
"""From the first form every step is gone, and what is new is most often wrong at the last ones."""


@pytest.fixture(params=["sqlite", "postgres"])
async def url(request, tmp_path):
    if request.param == "postgres":
        return await request.getfixturevalue("postgres").empty()
    return f"sqlite+aiosqlite:///{tmp_path / 'farm.sqlite'}"


async def on(url, work):
    database = Database(url)
    try:
        async with database.write() as tx:
            return await tx.run_sync(work)
    finally:
        await database.close()


def filled(connection):
    """Puts the rows into the tables as they are in this form."""
    found = MetaData()
    found.reflect(connection)
    for name, rows in ROWS.items():
        more = {column: value for column, value in LATER.get(name, {}).items() if column in found.tables[name].c}
        connection.execute(insert(found.tables[name]), [row | more for row in rows])


def content(connection):
    """All rows of all tables, in the columns of this form."""
    found = MetaData()
    found.reflect(connection)
    names = [name for name in sorted(found.tables) if name != "alembic_version"]
    return {name: sorted(map(str, connection.execute(select(found.tables[name])).mappings())) for name in names}


def shape(connection):
    found = inspect(connection)
    tables = {name: {each["name"]: each["nullable"] for each in found.get_columns(name)} for name in found.get_table_names()}
    own = {name: [each for each in found.get_indexes(name) if "duplicates_constraint" not in each] for name in tables}
    return tables, {name: {each["name"]: each["unique"] for each in own[name]} for name in tables}


async def test_the_newest_form_has_exactly_the_tables_that_the_code_uses(url):
    await migrate(url)
    await migrate(url)  # again, and nothing changes
    tables, indexes = await on(url, shape)
    tables.pop("alembic_version")
    assert tables == {t.name: {c.name: c.nullable for c in t.columns} for t in metadata.sorted_tables}
    for table in metadata.sorted_tables:
        assert indexes[table.name] == {index.name: index.unique for index in table.indexes}


@pytest.mark.parametrize("form", [pytest.param(form, marks=[pytest.mark.scale] * (form not in ENDS)) for form in RELEASED[:-1]])
async def test_what_a_released_form_holds_is_kept_and_comes_back(url, form):
    """`test_what_a_released_form_holds_is_kept_and_comes_back` begins with the first form and the last ones without scale."""
    await migrate(url, form)
    await on(url, filled)
    before = await on(url, content)
    await migrate(url)
    columns = "trial_id, trial.owner, trial.seed, lease_until_s, object, trials_done"
    kept = select(text(columns)).select_from(text("trial JOIN job ON number = job_number")).order_by(text("trial_id"))
    rows = await on(url, lambda tx: tx.execute(kept).all())
    assert rows == [("j1-000", "ann", 7, 9.5, "cube", 1), ("j1-001", "ann", 7, None, "cube", 1)]
    assert await on(url, lambda tx: tx.execute(text("SELECT trials_done FROM robot")).scalar_one()) == 1
    await migrate(url, form, back=True)
    assert await on(url, content) == before


async def test_a_newer_form_is_refused_and_left_alone(url):
    await migrate(url)
    await on(url, lambda tx: tx.execute(text("UPDATE alembic_version SET version_num = '9999'")))
    with pytest.raises(NotReady, match=rf"schema 9999; this version of the services knows schemas up to {RELEASED[-1]}; start"):
        await migrate(url)
    assert await form_of(url) == "9999"


async def test_services_that_start_at_once_migrate_once(postgres):
    url = await postgres.empty()
    code = "import asyncio, sys; from services.database.database import migrate; asyncio.run(migrate(sys.argv[1]))"
    command = (sys.executable, "-c", code, url)
    started = [await asyncio.create_subprocess_exec(*command) for _ in range(3)]
    assert [await each.wait() for each in started] == [0, 0, 0]
    assert await form_of(url) == RELEASED[-1]


async def test_a_server_that_is_too_old_is_refused_and_left_alone(postgres, monkeypatch):
    url = await postgres.empty()
    monkeypatch.setattr("services.database.postgres.OLDEST", 999)
    with pytest.raises(NotReady, match=r"it is PostgreSQL \d+\.\d+, and the farm needs 999 or newer; update the server"):
        await migrate(url)
    monkeypatch.undo()
    assert await form_of(url) is None


async def test_a_server_that_is_not_there_is_named_without_its_password():
    with pytest.raises(NotReady, match=r"postgresql\+asyncpg://ann:\*\*\*@127.0.0.1:1/farm cannot be opened"):
        await migrate("postgresql+asyncpg://ann:secret@127.0.0.1:1/farm")


@pytest.mark.parametrize("given", ["mysql://a/b", "farm"])
def test_another_kind_of_database_is_refused(given):
    with pytest.raises(NotReady, match="give postgresql://"):
        address(given)
