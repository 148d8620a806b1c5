"""An open page goes on through a database that is away for a moment."""

from types import SimpleNamespace

import pytest
from sqlalchemy.exc import OperationalError

from services.dashboard import live
from services.errors import NotFound, Unavailable
from services.jobs.signals import Signals


async def heard(farm, answers, most):
    """The events of a page whose parts are made so, one after another; what is an error is raised."""

    async def make():
        if isinstance(now := answers.pop(0), Exception):
            raise now
        return now

    session, events = SimpleNamespace(bearer="bearer", lasts=True), []
    async for event in live.stream(farm, session, make):
        events.append((event.event, event.raw_data))
        if len(events) == most:
            break
    return events


@pytest.fixture
def farm(monkeypatch):
    monkeypatch.setattr(live, "EVERY_S", 0.01)

    async def caller(_bearer):
        return None

    return SimpleNamespace(signals=Signals(), tokens=SimpleNamespace(caller=caller))


@pytest.mark.parametrize("away", [Unavailable("database-unavailable", "away"), OperationalError("SELECT 1", None, OSError())])
async def test_what_is_shown_stays_while_the_database_is_away(farm, away):
    events = await heard(farm, [{"a": "1"}, away, away, {"a": "2"}], 2)
    assert events == [("parts", '{"a": "1"}'), ("parts", '{"a": "2"}')]


async def test_a_page_whose_object_has_gone_is_loaded_again(farm):
    assert await heard(farm, [{"a": "1"}, NotFound("job-not-found", "gone")], 2) == [("parts", '{"a": "1"}'), ("anew", "{}")]
