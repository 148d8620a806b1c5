"""A dispatcher that begins to lead, was stopped while it led, and leads no more: over a real session and database."""

import asyncio
import time

import pytest
from prometheus_client import CollectorRegistry, Gauge

from services.disk import Disk
from services.dispatcher import dispatcher as dispatcher_module
from services.dispatcher import leading
from services.dispatcher.bus import Bus
from services.dispatcher.dispatcher import Dispatcher, Metrics
from services.dispatcher.leading import Leadership
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from services.settings import Settings
from tests.unit.services.dispatcher.test_bus import config, until


@pytest.fixture
async def dispatcher(database, tmp_path, fleet_of, monkeypatch):
    """One of several that may lead, which shows robots to nobody; it asks often, and a lead lasts half a second."""
    if not database.is_shared:
        pytest.skip("nobody shares SQLite")
    monkeypatch.setattr(dispatcher_module, "ASKS_EVERY_S", 0.02)
    monkeypatch.setattr(leading, "LEADS_S", 0.5)
    clock, signals, metrics = FarmClock.start(), Signals(), Metrics.register(CollectorRegistry())
    bus, disk = await Bus.open(config(), "farm"), Disk(tmp_path, reserve_bytes=0)
    made = Dispatcher(Settings(data=tmp_path), database, bus, clock, fleet_of(), signals, metrics, disk, shows=False)
    staying = asyncio.create_task(made._stay_leader())
    await until(lambda: made._leading.leads)
    yield made
    signals.closing.set()
    await staying
    await bus.close()


async def test_who_begins_to_lead_hears_robots_and_settles(dispatcher):
    await until(lambda: dispatcher._hears)
    assert dispatcher._gives_from_s > time.monotonic()


async def test_who_was_stopped_while_it_led_remembers_nothing_of_who_is_gone(dispatcher):
    await until(lambda: dispatcher._hears)
    dispatcher._abandoner._since_s["robot-0"] = 0.0
    time.sleep(0.7)  # noqa: ASYNC251  as a process that is stopped
    assert not dispatcher._leading.leads
    await until(lambda: dispatcher._leading.leads)
    assert dispatcher._abandoner._since_s == {}
    assert dispatcher._gives_from_s > time.monotonic()


async def test_who_leads_no_more_hears_nobody(database, dispatcher):
    await until(lambda: dispatcher._hears)
    other = Leadership(database, Gauge("leads", "", registry=CollectorRegistry()))
    await dispatcher._leading.let_go()
    await other.look(is_of_use=True)
    assert other.leads
    await until(lambda: not dispatcher._hears)
    assert not dispatcher._leading.leads
