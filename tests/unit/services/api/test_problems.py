"""What a database refuses is told apart: the value of a request, or the database itself."""

import httpx
import pytest
from fastapi import FastAPI, Request
from sqlalchemy import select, text
from structlog.testing import capture_logs

from services.api import problems
from services.database.tables import job, trial

STATEMENTS = {
    "number too large": select(trial).where(trial.c.ordinal > 10**17),
    "text with NUL": select(job).where(job.c.job_id == "\0"),
    "no such table": text("SELECT 1 FROM nowhere"),
}
FULL = {
    False: ("PRAGMA max_page_count = 1", "CREATE TABLE one_more AS SELECT randomblob(10000000)"),
    True: ("DO $$ BEGIN RAISE EXCEPTION USING ERRCODE = '53100'; END $$",),
}
"""What makes a database say that its disk is full; of PostgreSQL's server that cannot be asked for in earnest."""


@pytest.fixture
async def ask(new_database):
    app = FastAPI()
    problems.install(app)

    @app.get("/{name}")
    async def execute(name: str) -> int:
        async with new_database.read() as connection:
            return len((await connection.execute(STATEMENTS[name])).all())

    @app.post("/full")
    async def fill() -> None:
        async with new_database.read() as connection:
            for statement in FULL[new_database.is_shared]:
                await connection.execute(text(statement))

    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://farm") as client:
        yield client


async def test_a_value_that_does_not_fit_is_no_silence_of_the_database(ask, new_database):
    for name in ("number too large", "text with NUL"):
        answer = await ask.get(f"/{name}")
        if new_database.is_shared:
            assert (answer.status_code, answer.json()["type"]) == (422, "/problems/value-unfit"), name
        else:
            assert answer.json() == 0, name  # SQLite looks for both, and finds nothing
    with capture_logs() as lines:
        answer = await ask.get("/no such table")
    assert (answer.status_code, answer.json()["type"]) == (503, "/problems/database-unavailable")
    assert [line["event"] for line in lines] == ["database error"]


async def test_a_full_disk_of_the_database_is_named(ask):
    answer = await ask.post("/full")
    assert (answer.status_code, answer.json()["type"]) == (503, "/problems/disk-full")
    assert answer.headers["Retry-After"] == "2"


async def test_a_sender_who_leaves_is_no_error_of_the_farm():
    app, said = FastAPI(), []
    problems.install(app)

    @app.post("/body")
    async def take(request: Request) -> int:
        return len(await request.body())

    async def receive():
        return {"type": "http.disconnect"}

    async def send(message):
        said.append(message)

    scope = {"type": "http", "method": "POST", "path": "/body", "headers": [], "query_string": b"", "state": {}}
    with capture_logs() as lines:
        await app(scope, receive, send)
    assert [line["log_level"] for line in lines] == ["info"]
    assert said[0]["status"] == 400
