"""What a database refuses is told apart: the value of a request, or the database itself."""

import httpx
import pytest
from fastapi import FastAPI
from sqlalchemy import select, text
from structlog.testing import capture_logs

from services.api import problems
from services.database.tables import job, trial

STATEMENTS = {
    "number too large": select(trial).where(trial.c.ordinal > 10**17),
    "text with NUL": select(job).where(job.c.job_id == "\0"),
    "no such table": text("SELECT 1 FROM nowhere"),
}


@pytest.fixture
async def ask(new_database):
    app = FastAPI()
    problems.install(app)

    @app.get("/{name}")
    async def execute(name: str) -> int:
        async with new_database.read() as connection:
            return len((await connection.execute(STATEMENTS[name])).all())

    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://farm") as client:
        yield client.get


async def test_a_value_that_does_not_fit_is_no_silence_of_the_database(ask, new_database):
    for name in ("number too large", "text with NUL"):
        answer = await ask(f"/{name}")
        if new_database.is_shared:
            assert (answer.status_code, answer.json()["type"]) == (422, "/problems/value-unfit"), name
        else:
            assert answer.json() == 0, name  # SQLite looks for both, and finds nothing
    with capture_logs() as lines:
        answer = await ask("/no such table")
    assert (answer.status_code, answer.json()["type"]) == (503, "/problems/database-unavailable")
    assert [line["event"] for line in lines] == ["database error"]
