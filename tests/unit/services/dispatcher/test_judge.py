"""Questions are brought forward when something has changed, and again where that failed."""

import pytest
from sqlalchemy import insert
from structlog.testing import capture_logs

from services.database.tables import question
from services.dispatcher import judge
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals


@pytest.fixture
async def with_question(database):
    async with database.write() as tx:
        await tx.execute(insert(question).values(job_number=1, bar=0.5, findable="[]"))
    return database


def look_at(database, monkeypatch, *ends):
    """A judge whose looks at the question end so, one after the other, and then well; and the numbers it looked at."""
    looks, left = [], iter(ends)

    async def move(_tx, _now_s, number, _robots):
        looks.append(number)
        for error in left:
            raise error
        return []

    monkeypatch.setitem(judge.MOVES, "question", move)
    return judge.Judge(database, FarmClock.start(), Signals(), database.write), looks


async def test_what_could_not_be_brought_forward_is_looked_at_until_it_can_and_told_once(with_question, monkeypatch):
    looking, looks = look_at(with_question, monkeypatch, ValueError("a mistake of ours"), ValueError("and again"))
    with capture_logs() as lines:
        for _ in range(5):
            await looking.look({"r0"}, also_failed=True)
    assert looks == [1, 1, 1]
    assert [line["event"] for line in lines] == ["a question could not be brought forward"]


async def test_what_failed_is_left_alone_between_looks_at_everything_until_something_changes(with_question, monkeypatch):
    looking, looks = look_at(with_question, monkeypatch, *[ValueError("a mistake of ours")] * 3)
    counts = []
    for robots, also_failed in (("r0", False), ("r0", False), ("r0", True), ("r0", False), ("r1", False), ("r1", True)):
        await looking.look({robots}, also_failed=also_failed)
        counts.append(len(looks))
    assert counts == [1, 1, 2, 2, 3, 4]


async def test_a_database_that_answers_too_late_is_away(with_question, monkeypatch):
    looking, looks = look_at(with_question, monkeypatch, TimeoutError())
    with pytest.raises(TimeoutError):
        await looking.look({"r0"}, also_failed=True)
    await looking.look({"r0"}, also_failed=False)
    assert looks == [1, 1]
