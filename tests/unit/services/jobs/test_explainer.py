"""A question whose files cannot be read is answered with the reason."""

import hashlib
import tempfile

import pytest
from sqlalchemy import select, update

from api_schemas.why import WhyState
from jail.level import JailLevel
from services.database.tables import policy, trial, why
from services.files.store import FileStore
from services.jobs.clock import FarmClock
from services.jobs.explainer import Explainer
from tests.unit.services.jobs.test_whys import ask, database  # noqa: F401

CONTENT = b"a log"
KEPT = hashlib.sha256(CONTENT).hexdigest()


@pytest.mark.parametrize(
    ("is_there", "said"),
    [(False, "was removed from the farm"), (True, "could not read or copy its files (No such file or directory)")],
    ids=["a log that was removed", "no folder for copies"],
)
async def test_a_question_whose_log_cannot_be_read_says_so_at_once(database, tmp_path, monkeypatch, is_there, said):  # noqa: F811
    async def body():
        yield CONTENT

    files = FileStore(tmp_path / "files")
    await files.put(body(), limit_bytes=100)
    async with database.write() as tx:
        await tx.execute(update(trial).values(log_sha256=KEPT, truth_sha256=KEPT))
        await tx.execute(update(policy).values(graph_sha256=KEPT))
    if is_there:
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    else:
        (tmp_path / "files" / "sha256" / KEPT[:2] / KEPT).unlink()
    await ask(database, 0)
    assert await Explainer(database, files, FarmClock.start(), JailLevel.NONE, 60.0).explain_next()
    async with database.read() as connection:
        row = (await connection.execute(select(why))).one()
    assert row.state == WhyState.FAILED
    assert said in row.problem
    assert str(tmp_path) not in row.problem
