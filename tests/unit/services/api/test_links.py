"""Links as other sites' readers use them: on the application with its door, a real store, and readers that stop reading."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from sqlalchemy import insert, update
from structlog.testing import capture_logs

from api_schemas.job import JobRequest
from api_schemas.token import Scope, TokenRequest
from services.api.app import create_app
from services.api.links import MOST_READERS, Link, linked
from services.database.database import Database
from services.database.tables import policy, trial
from services.files.store import FileStore
from services.jobs.clock import FarmClock
from services.jobs.submission import Sender, submit
from services.settings import Settings
from services.signing import FarmKey
from services.tokens import Caller, Tokens

DIGEST = "d" * 64
LASTS_S = 600.0
POLICY = {"number": 1, "digest": DIGEST, "name": "p", "weights_format": "onnx", "weights_sha256": DIGEST, "weights_bytes": 1}
POLICY |= {"graph_sha256": DIGEST, "manifest": "{}", "warnings": "[]", "owner": "ann", "created_at": "now"}


async def _log():
    yield b"l" * 2_000_000


@pytest.fixture
async def farm(sqlite_url, tmp_path):
    """What links need of a farm, with one trial whose log takes several messages to send."""
    database, clock = Database(sqlite_url), FarmClock.start()
    files, tokens = FileStore(tmp_path), Tokens(database, clock)
    stored = await files.put(_log(), limit_bytes=10**7)
    async with database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        wish = JobRequest.model_validate({"policy": DIGEST, "task": "push", "trials": 1})
        job_id, _ = await submit(tx, 1000.0, wish, Sender("ann"))
        await tx.execute(update(trial).values(log_sha256=stored.sha256))
    parts = {"settings": Settings(anonymous_requests_per_s=0), "database": database, "files": files, "clock": clock}
    parts |= {"tokens": tokens, "key": FarmKey(b"k" * 32), "version": "1"}
    made = SimpleNamespace(**parts, registry=CollectorRegistry(), trial_id=f"{job_id}-000", sha256=stored.sha256)
    yield made
    await database.close()


async def token_of(farm):
    return (await farm.tokens.make(TokenRequest(owner="ann", scopes=(Scope.SUBMIT,)))).token_id


def link_of(farm, token_id):
    return Link(farm.trial_id, farm.sha256, token_id, int(farm.clock.now_s() + LASTS_S))


class Reader:
    """Asks for a link and takes the beginning of the answer; the rest when it is told to go on."""

    def __init__(self, app, path):
        self.messages, self.go_on, self.begun = [], asyncio.Event(), asyncio.Event()
        scope = {"type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": "GET", "path": path}
        scope |= {"raw_path": path.encode(), "query_string": b"", "headers": [(b"host", b"farm")], "client": ("192.0.2.1", 1)}
        scope |= {"scheme": "http", "server": ("farm", 80), "root_path": ""}
        self.reading = asyncio.create_task(app(scope, self._receive, self._send))

    async def _receive(self):
        await asyncio.sleep(600)
        return {"type": "http.disconnect"}

    async def _send(self, message):
        self.messages.append(message)
        self.begun.set()
        if message["type"] == "http.response.body":
            await self.go_on.wait()

    @property
    def status(self):
        return self.messages[0]["status"]

    @property
    def is_whole(self):
        return not self.messages[-1].get("more_body", True)


async def reader(app, farm, link):
    asks = Reader(app, link.path(farm))
    await asyncio.wait_for(asks.begun.wait(), 120)
    return asks


@pytest.mark.parametrize("ends", ["token", "time"])
async def test_an_answer_ends_with_its_link(farm, ends):
    app, token_id = create_app(farm), await token_of(farm)
    stalled = await reader(app, farm, link_of(farm, token_id))
    assert stalled.status == 200
    if ends == "token":
        await farm.tokens.revoke(token_id)
    else:
        farm.clock.started_s += LASTS_S
    await asyncio.wait_for(stalled.reading, 120)
    assert not stalled.is_whole and not app.state.link_readers


async def test_a_token_has_so_many_readers_of_its_links(farm):
    app, token_id, other = create_app(farm), await token_of(farm), await token_of(farm)
    stalled = [await reader(app, farm, link_of(farm, token_id)) for _ in range(MOST_READERS)]
    assert {each.status for each in stalled} == {200}
    refused = await reader(app, farm, link_of(farm, token_id))
    assert refused.status == 429 and b"/problems/too-many-link-readers" in refused.messages[1]["body"]
    another = await reader(app, farm, link_of(farm, other))
    assert another.status == 200
    for each in (*stalled, refused, another):
        each.go_on.set()
        await asyncio.wait_for(each.reading, 120)
    assert all(each.is_whole for each in stalled) and not app.state.link_readers
    again = await reader(app, farm, link_of(farm, token_id))
    assert again.status == 200
    again.go_on.set()
    await asyncio.wait_for(again.reading, 120)


async def test_the_making_and_the_reading_of_links_are_logged_without_what_opens_them(farm):
    app, token_id = create_app(farm), await token_of(farm)
    caller = Caller(token_id, "ann", frozenset({Scope.SUBMIT}))
    shown: Any = SimpleNamespace(trial_id=farm.trial_id, log_sha256=farm.sha256)
    with capture_logs() as lines:
        link = linked(shown, caller, farm)
        reads = await reader(app, farm, link)
        reads.go_on.set()
        await asyncio.wait_for(reads.reading, 120)
    told = {line["event"]: line for line in lines}
    for event in ("link made", "link read"):
        assert (told[event]["trial"], told[event]["token_id"]) == (farm.trial_id, token_id)
    assert link.signature(farm) not in str(lines)
