"""A question whose files cannot be read is answered with the reason."""

import errno
import hashlib
import os
import tempfile

import pytest
from sqlalchemy import select, update

from api_schemas.why import WhyState
from jail.level import JailLevel
from services.database.tables import policy, trial, why
from services.files.store import FileStore
from services.jobs import explainer
from services.jobs.clock import FarmClock
from services.jobs.explainer import Explainer
from tests.unit.services.jobs.test_whys import ask, database  # noqa: F401

CONTENT = b"a log"
KEPT = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
async def asked(database, tmp_path):  # noqa: F811
    """A farm whose files are all there, and a question; gives its database, what answers, and the file."""

    async def body():
        yield CONTENT

    files = FileStore(tmp_path / "files")
    await files.put(body(), limit_bytes=100)
    async with database.write() as tx:
        await tx.execute(update(trial).values(log_sha256=KEPT, truth_sha256=KEPT))
        await tx.execute(update(policy).values(graph_sha256=KEPT))
    await ask(database, 0)
    answering = Explainer(database, files, FarmClock.start(), JailLevel.NONE, 60.0)
    return database, answering, tmp_path / "files" / "sha256" / KEPT[:2] / KEPT


async def question(database):  # noqa: F811
    async with database.read() as connection:
        return (await connection.execute(select(why))).one()


async def test_a_question_whose_log_was_removed_says_so_at_once(asked):
    database, answering, kept = asked  # noqa: F811
    kept.unlink()
    assert await answering.explain_next()
    row = await question(database)
    assert (row.state, row.tries) == (WhyState.FAILED, 1)
    assert "was removed from the farm" in row.problem


def no_room(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/tmp/trifarm-why-1/log.mcap")


async def no_interpreter(*_):
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "/gone/python")


@pytest.mark.parametrize(
    ("where", "name", "failing", "said"),
    [
        (tempfile, "mkdtemp", no_room, "2 times (No space left on device)"),
        (explainer, "explain", no_interpreter, "2 times (No such file or directory)"),
    ],
    ids=["a full disk", "no interpreter"],
)
async def test_what_may_pass_is_tried_again_and_told_as_what_it_is_the_last_time(asked, monkeypatch, where, name, failing, said):
    database, answering, kept = asked  # noqa: F811
    monkeypatch.setattr(where, name, failing)
    with pytest.raises(OSError, match="No "):
        await answering.explain_next()
    assert (await question(database)).state == WhyState.RUNNING
    async with database.write() as tx:
        await tx.execute(update(why).values(due_s=0.0))  # it was held for long enough
    assert await answering.explain_next()
    row = await question(database)
    assert row.state == WhyState.FAILED
    assert said in row.problem
    assert "removed" not in row.problem
    assert kept.name not in row.problem and "/" not in row.problem
