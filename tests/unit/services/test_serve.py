"""A start that was cut short can be made again, and a clock that goes back is followed."""

import asyncio
import json
import time
from contextlib import suppress
from types import SimpleNamespace

import pytest
from sqlalchemy import select
from structlog.testing import capture_logs

from services import serve
from services.api.rate_limits import Limits
from services.dashboard.sessions import EndedSessions
from services.database.pages import Asked
from services.database.tables import trial, turn
from services.errors import NotReady, ServiceError
from services.jobs import robots
from services.jobs.clock import FarmClock
from services.settings import Settings
from services.sharing import note_signed_out
from services.tokens import Tokens
from tests.disk_steps import in_place, noted_steps
from tests.unit.services.conftest import beat
from tests.unit.services.jobs.test_pinning import NOW_S, asked, take


def full(*_):
    raise OSError(28, "No space left on device")


async def test_when_the_clock_goes_back_no_lease_and_no_pause_lasts_longer(new_database, tmp_path, monkeypatch, fleet_of):
    fleet, clock, settings = fleet_of("a", now_s=NOW_S), FarmClock.start(), Settings(data=tmp_path, lease_s=15.0)
    async with new_database.write() as tx:
        await robots.keep(tx, [beat("a")], NOW_S)
    await asked(new_database, "a")
    await take(new_database, "a", fleet)  # a lease until 15 s after NOW_S
    fleet.member("a").paused_until_s = NOW_S + 1.0
    now_s = NOW_S - 600.0

    async def set_by(_database):
        return 600.0

    monkeypatch.setattr(clock, "set_by", set_by)
    monkeypatch.setattr(clock, "now_s", lambda: now_s)
    farm = SimpleNamespace(clock=clock, fleet=fleet, database=new_database, settings=settings)
    await serve._ClockFollower(farm).follow()
    async with new_database.read() as connection:
        until_s = (await connection.execute(select(trial.c.lease_until_s).where(trial.c.robot == "a"))).scalar_one()
        assert (await connection.execute(select(turn.c.served_s))).scalar_one() == now_s
    member = fleet.member("a")
    assert (until_s, member.seen_s, member.renewed_s, member.paused_until_s) == (now_s + 15.0, now_s, now_s, now_s)


@pytest.mark.parametrize("fails", [OSError("away"), None], ids=["the database is away", "somebody changes a row"])
async def test_what_could_not_be_brought_back_is_brought_back_the_next_time(monkeypatch, fails):
    backs, ends = iter((600.0, 0.0, 0.0)), iter((fails, True))
    brought = []

    async def set_by(_database):
        return next(backs)

    async def bring_back(_database, now_s, _settings):
        brought.append(now_s)
        if isinstance(end := next(ends), OSError):
            raise end
        return end

    monkeypatch.setattr(serve.times_ahead, "bring_back", bring_back)
    clock, fleet = SimpleNamespace(set_by=set_by, now_s=lambda: NOW_S), SimpleNamespace(went_back=lambda _now_s: None)
    follower = serve._ClockFollower(SimpleNamespace(clock=clock, fleet=fleet, database=None, settings=None))
    for _ in range(3):
        with suppress(OSError):
            await follower.follow()
    assert brought == [NOW_S, NOW_S]


async def test_of_what_was_signed_out_only_what_is_new_since_the_last_look_is_read(new_database, tmp_path):
    farm = SimpleNamespace(database=new_database, clock=FarmClock.start())
    until_s, limits = time.time() + 60.0, Limits.of(Settings(data=tmp_path))
    long_ago_s = farm.clock.now_s() - 2 * serve.OVERLAP_S
    async with new_database.write() as tx:
        await note_signed_out(tx, b"a", until_s, long_ago_s)
    first, second, later = EndedSessions(), EndedSessions(), EndedSessions()
    looked_s = await serve._exchange(farm, first, limits, None)
    async with new_database.write() as tx:
        await note_signed_out(tx, b"b", until_s, looked_s - serve.OVERLAP_S / 2)
    await serve._exchange(farm, second, limits, looked_s)
    await serve._exchange(farm, later, limits, looked_s + 1000.0)  # and the clock has gone back since
    read = [[each.has(mark, until_s) for mark in (b"a", b"b")] for each in (first, second, later)]
    assert read == [[True, False], [False, True], [False, True]]


async def test_everything_that_was_signed_out_is_read_every_few_minutes(monkeypatch):
    now_s, since, done = [1000.0], [], asyncio.Event()

    async def exchange(_farm, _ended, _limits, looked_s):
        since.append(looked_s)
        now_s[0] += 0.4 * serve.READ_ALL_EVERY_S
        if len(since) == 4:
            raise OSError("away")
        if len(since) == 6:
            done.set()
        return len(since)

    monkeypatch.setattr(serve, "_exchange", exchange)
    monkeypatch.setattr(serve, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(serve, "SHARE_EVERY_S", 0.001)
    farm = SimpleNamespace(database=SimpleNamespace(is_shared=True))
    sharing = asyncio.create_task(serve._share(farm, None, None))
    await asyncio.wait_for(done.wait(), 120)
    sharing.cancel()
    assert since[:6] == [None, 1, 2, None, None, 5]


async def test_what_is_repeated_goes_on_after_an_error_that_nobody_expected_and_it_is_in_the_log():
    errors, done = iter((OSError("away"), ValueError("a mistake of ours"), ServiceError("slug", "not now"))), asyncio.Event()

    async def work():
        for error in errors:
            raise error
        done.set()

    with capture_logs() as lines:
        running = asyncio.create_task(serve._repeat("it failed", 0.001, work))
        await asyncio.wait_for(done.wait(), 120)
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    assert [(line["event"], line["log_level"]) for line in lines] == [
        ("it failed", "warning"),
        ("it failed", "error"),
        ("it failed", "warning"),
    ]


@pytest.mark.parametrize("cut_short", ["_write_privately", "keep"])
async def test_the_first_tokens_are_in_their_file_also_if_the_first_start_was_cut_short(
    new_database, tmp_path, monkeypatch, cut_short
):
    settings, tokens = Settings(data=tmp_path), Tokens(new_database, FarmClock.start())
    with monkeypatch.context() as patched, pytest.raises(OSError, match="No space"):
        patched.setattr(Tokens if cut_short == "keep" else serve, cut_short, full)
        await serve._first_tokens(settings, tokens)
    for _ in range(2):
        await serve._first_tokens(settings, tokens)
    made = json.loads((tmp_path / serve.TOKENS_FILE).read_text())
    assert {name: (await tokens.caller(bearer)).owner for name, bearer in made.items()} == {"admin": "operator", "robot": "farm"}
    assert len((await tokens.page(Asked(10))).entries) == 2


async def test_the_first_tokens_are_on_the_disk_before_they_have_their_name(new_database, tmp_path, monkeypatch):
    steps = noted_steps(monkeypatch)
    await serve._first_tokens(Settings(data=tmp_path), Tokens(new_database, FarmClock.start()))
    assert steps == in_place("tokens.new", tmp_path / serve.TOKENS_FILE)


async def test_a_second_process_on_one_folder_removes_nothing_of_the_first(tmp_path):
    settings, unfinished = Settings(data=tmp_path / "farm"), tmp_path / "farm" / "files" / "incoming" / "half a log"
    async with serve.open_farm(settings):
        unfinished.write_bytes(b"half")
        async with serve.open_farm(settings):
            assert unfinished.exists()
    async with serve.open_farm(settings):
        assert not unfinished.exists()


async def test_a_certificate_that_cannot_be_used_is_said_and_leaves_no_task(tmp_path):
    pem = tmp_path / "certificate.pem"
    pem.write_text("no certificate")
    settings = Settings(data=tmp_path / "farm", port=0, bus="tcp/127.0.0.1:0", tls_certificate=pem, tls_key=pem)
    with pytest.raises(NotReady, match=r"TRIFARM_TLS_CERTIFICATE and TRIFARM_TLS_KEY name .*certificate\.pem"):
        await serve.serve(settings)
    assert asyncio.all_tasks() == {asyncio.current_task()}
