import asyncio
import sqlite3
import subprocess
import sys
import threading
import time

import asyncpg
import pytest
from sqlalchemy import insert, select, text
from sqlalchemy.dialects.postgresql.asyncpg import AsyncAdapt_asyncpg_connection
from sqlalchemy.exc import IntegrityError

from services.database import postgres as postgres_module
from services.database.database import Database, migrate
from services.database.postgres import server_clock_s
from services.database.sqlite import integrity_check
from services.database.tables import job, robot, token
from services.errors import Unavailable
from services.jobs.clock import FarmClock
from tests.homes import QUICK, postgres_server

JOB = {"job_id": "j2", "state": "queued", "task": "identify", "trials": 1, "seed": 1, "seed_drawn_by_server": True}
JOB |= {"owner": "ann", "created_at": "now", "created_s": 0.0, "any_robot": True}
ROW = {"token_id": "a", "owner": "o", "scopes": "admin", "secret_sha256": "0" * 64, "created_at": "now"}


@pytest.fixture
async def database(tmp_path):
    url = f"sqlite+aiosqlite:///{tmp_path / 'farm.sqlite'}"
    await migrate(url)
    opened = Database(url)
    yield opened
    await opened.close()


FIRST_FORM = """
INSERT INTO policy VALUES (1, '{d}', 'p', 'onnx', '{d}', 1, '{d}', '{{}}', '[]', 'ann', 'now');
INSERT INTO job VALUES (1, 'j1', 'running', '{d}', 'p', 'push', 1, 5, 0, 'ann', 'now', 0.0, NULL, NULL, NULL, 0, 0, 1, 0, 0, 0, 1,
    'key', NULL);
INSERT INTO trial VALUES ('j1-000', 1, 0, 'running', 5, '[]', NULL, NULL, NULL, 1, 'robot-0', 9.0, 0, NULL, NULL, NULL);
INSERT INTO attempt VALUES ('j1-000', 1, 1, 'robot-0', 'open', NULL, NULL, 'now', NULL, NULL, NULL);
INSERT INTO event VALUES (1, 1, 'now', 'job_queued', NULL, NULL, 'queued', 0, 0, 'queued');
"""


def rows(path, statement):
    with sqlite3.connect(path) as connection:
        found = connection.execute(statement).fetchall()
    connection.close()
    return found


async def test_what_the_first_form_holds_is_kept_and_comes_back(tmp_path):
    path = tmp_path / "farm.sqlite"
    url = f"sqlite+aiosqlite:///{path}"
    await migrate(url, "0001")
    with sqlite3.connect(path) as connection:
        connection.executescript(FIRST_FORM.format(d="d" * 64))
    connection.close()
    before = rows(path, "SELECT * FROM job"), rows(path, "SELECT * FROM trial"), rows(path, "SELECT * FROM attempt")
    await migrate(url)
    assert rows(path, "SELECT object, object_scale, robot, any_robot, policy FROM job") == [("cube", 1.0, None, 0, "d" * 64)]
    assert rows(path, "SELECT excitation, truth_sha256, seed, lease_until_s FROM trial") == [(None, None, 5, 9.0)]
    assert rows(path, "PRAGMA foreign_key_check") == []
    # What the tables promise is still promised: names are unique, rows have owners, numbers go on.
    opened = Database(url)
    for broken in (
        "UPDATE job SET job_id = 'j1' WHERE number = 2",
        "UPDATE trial SET job_number = 7",
        "UPDATE job SET policy = 'x'",
    ):
        with pytest.raises(IntegrityError):
            async with opened.write() as tx:
                await tx.execute(insert(job).values(JOB))
                await tx.execute(text(broken))
    async with opened.write() as tx:
        assert (await tx.execute(insert(job).values(JOB).returning(job.c.number))).scalar() == 2
    await opened.close()
    with pytest.raises(ValueError, match=r"cannot hold 1 jobs .*\(j2\); nothing was changed"):
        await migrate(url, "0001", back=True)
    assert rows(path, "SELECT job_id, object FROM job") == [("j1", "cube"), ("j2", "cube")]
    rows(path, "DELETE FROM job WHERE job_id = 'j2'")
    await migrate(url, "0001", back=True)
    assert (rows(path, "SELECT * FROM job"), rows(path, "SELECT * FROM trial"), rows(path, "SELECT * FROM attempt")) == before
    assert rows(path, "SELECT count(*) FROM event") == [(1,)]


async def test_policies_of_the_older_forms_belong_to_who_sent_them_and_to_who_ran_them(tmp_path):
    path = tmp_path / "farm.sqlite"
    url = f"sqlite+aiosqlite:///{path}"
    await migrate(url, "0001")
    with sqlite3.connect(path) as connection:
        connection.executescript(FIRST_FORM.format(d="d" * 64))
        for number, owner in ((2, "bob"), (3, "bob")):
            columns = "job_id, state, policy, policy_name, task, trials, seed, seed_drawn_by_server, owner, created_at, created_s"
            more = "cancel_requested, trials_done, trials_active, successes, policy_faults, platform_faults, last_event"
            values = (f"j{number}", "succeeded", "d" * 64, "p", "push", 1, 1, 0, owner, f"then {number}", 0.0, *[0] * 7)
            connection.execute(f"INSERT INTO job ({columns}, {more}) VALUES ({','.join('?' * len(values))})", values)
    connection.close()
    await migrate(url)
    owned = [("d" * 64, "ann", "now"), ("d" * 64, "bob", "then 2")]
    assert rows(path, "SELECT digest, owner, created_at FROM policy_owner ORDER BY number") == owned
    for token_id, of_robot in (("t", "'r'"), ("u", "NULL")):
        values = f"VALUES ('{token_id}', 'o', 'robot', 's', 'now', {of_robot})"
        rows(path, f"INSERT INTO token (token_id, owner, scopes, secret_sha256, created_at, robot) {values}")
    await migrate(url, "0002", back=True)
    assert rows(path, "SELECT token_id FROM token") == [("u",)]  # one robot's token would have become the whole farm's


@pytest.mark.parametrize("change", ["object = 'sphere'", "object_scale = 0.8"])
async def test_no_job_turns_into_one_of_the_cube_by_going_back(tmp_path, change):
    path = tmp_path / "farm.sqlite"
    url = f"sqlite+aiosqlite:///{path}"
    await migrate(url, "0001")
    with sqlite3.connect(path) as connection:
        connection.executescript(FIRST_FORM.format(d="d" * 64))
    connection.close()
    await migrate(url)
    rows(path, f"UPDATE job SET {change}")
    before = rows(path, "SELECT * FROM job")
    with pytest.raises(ValueError, match=r"\(j1\)"):
        await migrate(url, "0001", back=True)
    assert rows(path, "SELECT * FROM job") == before


KILLED = """
import asyncio, os, signal, sys
from sqlalchemy import event
from sqlalchemy.engine import Engine
from services.database.database import migrate

@event.listens_for(Engine, "before_cursor_execute")
def end(connection, cursor, statement, *_):
    if sys.argv[2] in statement:
        os.kill(os.getpid(), signal.SIGKILL)

asyncio.run(migrate(sys.argv[1], *sys.argv[3:4], back=len(sys.argv) > 3))
"""


def killed(url, statement, *back):
    ran = subprocess.run([sys.executable, "-c", KILLED, url, statement, *back], check=False, stderr=subprocess.PIPE)
    assert ran.returncode == -9, ran.stderr.decode()


def form(path):
    """All tables, as they are defined, and the revision."""
    return rows(path, "SELECT name, sql FROM sqlite_master ORDER BY name"), rows(path, "SELECT version_num FROM alembic_version")


@pytest.mark.parametrize(
    "statement", ["DROP TABLE job", pytest.param("ALTER TABLE trial ADD", marks=pytest.mark.scale), "UPDATE alembic_version"]
)
async def test_a_kill_in_the_middle_of_a_migration_leaves_the_form_from_before(tmp_path, statement):
    """`test_a_kill_in_the_middle_of_a_migration_leaves_the_form_from_before` has one in the middle and one at the end."""
    path = tmp_path / "farm.sqlite"
    url = f"sqlite+aiosqlite:///{path}"
    await migrate(url, "0001")
    with sqlite3.connect(path) as connection:
        connection.executescript(FIRST_FORM.format(d="d" * 64))
    connection.close()
    first, jobs = form(path), rows(path, "SELECT * FROM job")
    killed(url, statement)
    assert (form(path), rows(path, "SELECT * FROM job")) == (first, jobs)
    await migrate(url)
    newest = form(path)
    killed(url, statement.replace("ALTER TABLE trial ADD", "DROP TABLE trial"), "0001")
    assert form(path) == newest
    await migrate(url, "0001", back=True)
    assert rows(path, "SELECT * FROM job") == jobs


async def test_an_acknowledged_commit_is_synced_to_disk(database):
    async with database.write() as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 2
        assert (await tx.execute(text("PRAGMA journal_mode"))).scalar() == "wal"
        assert (await tx.execute(text("PRAGMA foreign_keys"))).scalar() == 1
    async with database.write(lasting=False) as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 1
    async with database.write() as tx:
        assert (await tx.execute(text("PRAGMA synchronous"))).scalar() == 2


async def test_an_error_takes_the_whole_transaction_back(new_database):
    with pytest.raises(ZeroDivisionError):
        async with new_database.write() as tx:
            await tx.execute(insert(token).values(ROW))
            raise ZeroDivisionError
    async with new_database.read() as connection:
        assert (await connection.execute(select(token))).all() == []


async def test_many_write_at_once_and_readers_see_only_what_is_committed(new_database):
    async def write(name):
        async with new_database.write() as tx:
            await tx.execute(insert(token).values(ROW | {"token_id": name}))
            async with new_database.read() as connection:
                seen = (await connection.execute(select(token.c.token_id))).scalars().all()
            assert name not in seen
            await asyncio.sleep(0)

    await asyncio.gather(*(write(str(number)) for number in range(20)))
    async with new_database.read() as connection:
        assert len((await connection.execute(select(token))).all()) == 20


async def test_a_connection_that_is_never_given_back_does_not_keep_the_process(database):
    async with database.read(), database.write():
        drivers = [thread for thread in threading.enumerate() if "_connection_worker_thread" in thread.name]
        assert len(drivers) >= 2
        assert all(thread.daemon for thread in drivers)


async def test_integrity(database, tmp_path):
    assert integrity_check(tmp_path / "farm.sqlite") == "ok"


async def test_a_server_that_was_restarted_is_used_again_and_one_that_is_away_is_an_error_that_says_so():
    with postgres_server(*QUICK) as server:
        database = Database(server.url("postgres"))

        async def ask():
            async with database.read() as reader, database.write() as writer:
                return [(await each.execute(text("SELECT 1"))).scalar() for each in (reader, writer)]

        assert await ask() == [1, 1]
        server.stop()
        await asyncio.sleep(0.1)  # the word that the server ended its connections has come
        for way in (database.read, database.write):
            with pytest.raises(Unavailable, match="nothing was changed"):
                async with way():
                    pass
        await asyncio.to_thread(server.start)
        assert await ask() == [1, 1]
        await database.close()


async def test_a_connection_that_rested_and_does_not_answer_is_replaced_before_it_is_used(monkeypatch):
    with postgres_server(*QUICK) as server:
        database = Database(server.url("postgres"))
        pid = text("SELECT pg_backend_pid()")

        async def asked():
            async with database.read() as connection:
                return (await connection.execute(pid)).scalar()

        first = await asked()
        assert await asked() == first, "it is used again"

        def silent(connection):
            connection._handle_exception(asyncpg.ConnectionDoesNotExistError("the cable is cut"))

        monkeypatch.setattr(postgres_module, "RESTED_S", 0.0)
        with monkeypatch.context() as patched:
            patched.setattr(AsyncAdapt_asyncpg_connection, "ping", silent)
            assert await asked() != first
        await database.close()


async def test_words_with_a_character_that_one_database_refuses_are_kept_on_both(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(robot).values(robot="a", drain=False, first_seen_at="now", withdrawn="broke\0 down"))
    async with new_database.read() as connection:
        assert (await connection.execute(select(robot.c.withdrawn))).scalar() == "broke\ufffd down"


async def test_a_clock_that_is_set_by_the_database_does_not_follow_this_machines(new_database, monkeypatch):
    if not new_database.is_shared:
        pytest.skip("SQLite has no clock of its own")
    monkeypatch.setattr(time, "time", lambda: 0.0)
    clock = FarmClock.start()
    await clock.set_by(new_database)

    async def said_s():
        async with new_database.read() as connection:
            return float((await connection.execute(select(server_clock_s()))).scalar_one())

    assert await said_s() - 0.5 < clock.now_s() < await said_s() + 0.5
    last_s = clock.now_s()
    clock.started_s -= 3600
    assert clock.now_s() >= last_s
