"""The composition: opens everything one services process needs, serves until told to stop, closes it all again."""

import asyncio
import json
import os
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from importlib.metadata import version
from pathlib import Path

import structlog
import uvicorn
from prometheus_client import CollectorRegistry, ProcessCollector

from api_schemas.jail.detection import detect
from api_schemas.token import Scope, TokenRequest
from services.api.app import create_app
from services.api.farm import Farm
from services.api.tokens import Tokens
from services.dashboard.mount import mount
from services.database.database import Database, migrate
from services.dispatcher.bus import Bus
from services.dispatcher.dispatcher import Dispatcher, Metrics
from services.files.store import FileStore
from services.jobs import robots
from services.jobs.clock import FarmClock
from services.jobs.fleet import Fleet
from services.jobs.signals import Signals
from services.policies.keeping import Policies
from services.router import told_to_stop
from services.settings import Settings

log = structlog.get_logger()
ADMIN = TokenRequest(owner="operator", scopes=(Scope.ADMIN,))
ROBOT = TokenRequest(owner="farm", scopes=(Scope.ROBOT,))
TOKENS_FILE = "tokens.json"
REQUESTS_END_WITHIN_S = 2


class Server(uvicorn.Server):
    """uvicorn without its signal handlers: this process has its own order of ending."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leaves signals to ``serve``."""
        yield


async def serve(settings: Settings) -> None:
    """Serves until SIGINT, SIGTERM or the end of the parent process."""
    async with open_farm(settings) as farm, dispatching(farm):
        app = create_app(farm)
        mount(app, farm)
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            lifespan="off",
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=REQUESTS_END_WITHIN_S,
        )
        server = Server(config)
        watching = asyncio.create_task(_stop_when_told(server, farm.signals))
        log.info("jail", level=farm.jail.level, layers=farm.jail.layers, asked_for=settings.jail_level)
        log.info("serving", host=settings.host, port=settings.port, bus=settings.bus, data=str(settings.data))
        try:
            await server.serve()
        finally:
            watching.cancel()


async def _stop_when_told(server: uvicorn.Server, signals: Signals) -> None:
    log.info("stopping", reason=await told_to_stop())
    # Streams of events end first: the server waits for its connections.
    signals.close()
    server.should_exit = True


@asynccontextmanager
async def open_farm(settings: Settings) -> AsyncIterator[Farm]:
    """Opens database and files, brings them up to date, and makes the first tokens."""
    settings.data.mkdir(parents=True, exist_ok=True)
    await migrate(settings.database_url)
    database, clock, registry = Database(settings.database_url), FarmClock.start(), CollectorRegistry()
    ProcessCollector(registry=registry)
    files = FileStore(settings.data / "files")
    files.forget_unfinished()
    farm = Farm(
        settings=settings,
        database=database,
        files=files,
        policies=Policies(settings, database, files),
        clock=clock,
        fleet=Fleet(),
        signals=Signals(),
        tokens=Tokens(database, clock),
        registry=registry,
        version=version("trifarm"),
        verifications=asyncio.Semaphore(settings.verification_at_once),
        jail=await asyncio.to_thread(detect),
    )
    try:
        await _first_tokens(settings, farm.tokens)
        async with database.write() as tx:
            await robots.load(tx, farm.fleet, clock.now_s(), settings.lease_s)
        yield farm
    finally:
        farm.signals.close()
        await database.close()


@asynccontextmanager
async def dispatching(farm: Farm) -> AsyncIterator[Dispatcher]:
    """Opens the bus and runs the dispatcher beside whatever the block does."""
    settings = farm.settings
    bus = await Bus.open(settings.bus, settings.farm, connect=settings.bus_connect)
    metrics = Metrics.register(farm.registry)
    dispatcher = Dispatcher(settings, farm.database, bus, farm.clock, farm.fleet, farm.signals, metrics)
    running = asyncio.create_task(dispatcher.run())
    try:
        yield dispatcher
    finally:
        farm.signals.close()
        await running
        await bus.close()


async def _first_tokens(settings: Settings, tokens: Tokens) -> None:
    """Registers the tokens that were given; without any, makes a pair on the first start and leaves them in a file."""
    given = ((settings.admin_token, ADMIN), (settings.robot_token, ROBOT))
    for bearer, request in given:
        if bearer is not None:
            await tokens.register(bearer, request)
    if any(bearer is not None for bearer, _ in given) or await tokens.all():
        return
    made = {"admin": (await tokens.make(ADMIN)).secret, "robot": (await tokens.make(ROBOT)).secret}
    _write_privately(settings.data / TOKENS_FILE, json.dumps(made))


def _write_privately(path: Path, text: str) -> None:
    unfinished = path.with_suffix(".new")
    unfinished.unlink(missing_ok=True)
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text)
    unfinished.replace(path)
