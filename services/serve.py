"""The composition: opens everything one services process needs, serves until told to stop, closes it all again."""

import asyncio
import json
import os
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from math import inf
from pathlib import Path

import structlog
import uvicorn
from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from api_schemas.token import Scope, TokenRequest
from jail.detection import detect
from services import times_ahead
from services.api.app import create_app
from services.api.farm import Farm
from services.api.rate_limits import Limits
from services.connection import connection
from services.dashboard.mount import mount
from services.dashboard.sessions import EndedSessions
from services.database.database import Database, address, migrate
from services.database.sqlite import is_full_sqlite
from services.disk import Disk
from services.dispatcher import large_jobs
from services.dispatcher.bus import Bus
from services.dispatcher.dispatcher import Dispatcher, Metrics
from services.dispatcher.large_jobs import LargeJobs
from services.errors import NotReady, ServiceError
from services.files.homes import open_home
from services.files.store import FileStore
from services.folder_lock import LOCK, held, is_held
from services.hosts import Hosts, allowed_hosts
from services.jobs import explainer, robots
from services.jobs.clock import FarmClock, iso
from services.jobs.fleet import Fleet
from services.jobs.holding import Holding
from services.jobs.signals import Signals
from services.joining.session import session_config
from services.policies.keeping import Policies
from services.router import end_in_time, told_to_stop
from services.server import Server
from services.settings import Settings
from services.sharing import add_asked, all_signed_out, forget_old
from services.signing import FarmKey
from services.tokens import Tokens, new_bearer
from services.upkeep import retention
from services.upkeep.retention import Rules
from services.webhooks.delivery import LOOK_EVERY_S, Deliverer
from trial_logs.disk import is_full, put_in_place

log = structlog.get_logger()
ADMIN = TokenRequest(owner="operator", scopes=(Scope.ADMIN,))
ROBOT = TokenRequest(owner="farm", scopes=(Scope.ROBOT,))
TOKENS_FILE = "tokens.json"
REQUESTS_END_WITHIN_S = 2
TIDY_EVERY_S = 3600.0
SHARE_EVERY_S = 0.5
OVERLAP_S = 120.0
"""What was signed out so long before the last look is read again: a row comes later than its time says where the transaction
waited for a lock or another process's clock is behind."""
READ_ALL_EVERY_S = 300.0
"""How often everything that was signed out is read, whenever it says that it was: a clock may be behind by more than that."""
FOLLOW_EVERY_S = 10.0
"""How often the clock of a shared database is read again: clocks of two machines part by less than 1 ms in that time."""


async def serve(settings: Settings) -> None:
    """Serves until SIGINT, SIGTERM or the end of the parent process."""
    async with open_farm(settings) as farm, dispatching(farm):
        app = create_app(farm)
        mount(app, farm)
        config = uvicorn.Config(
            Hosts(app, allowed_hosts(settings)),
            host=settings.host,
            port=settings.port,
            http=connection(settings.head_within_s),
            lifespan="off",
            log_config=None,
            access_log=False,
            proxy_headers=settings.trusted_proxies is not None,
            forwarded_allow_ips=settings.trusted_proxies,
            ssl_certfile=settings.tls_certificate,
            ssl_keyfile=settings.tls_key,
            timeout_graceful_shutdown=REQUESTS_END_WITHIN_S,
        )
        try:
            config.load()
        except OSError as error:  # which ssl.SSLError is
            files = f"{settings.tls_certificate} and {settings.tls_key}"
            raise NotReady(f"TRIFARM_TLS_CERTIFICATE and TRIFARM_TLS_KEY name {files}, which cannot be used: {error}") from error
        server = Server(config, settings.head_within_s)
        sharing = asyncio.create_task(_share(farm, app.state.dashboard_seal.ended, app.state.limits))
        watching = asyncio.create_task(_stop_when_told(server, farm.signals))
        log.info("jail", level=farm.jail.level, layers=farm.jail.layers, asked_for=settings.jail_level)
        where = {"host": settings.host, "port": settings.port, "bus": settings.bus, "data": str(settings.data)}
        log.info("serving", scheme="http" if settings.tls_key is None else "https", **where)
        try:
            await server.serve()
        finally:
            watching.cancel()
            sharing.cancel()
            await asyncio.wait((watching, sharing))


async def _share(farm: Farm, ended: EndedSessions, limits: Limits) -> None:
    """Learns who has signed out, once where nobody else serves this farm, and tells how often who asks where somebody does."""
    told_away, looked_s, reads_all_s = False, None, -inf
    while True:
        if time.monotonic() >= reads_all_s:
            looked_s, reads_all_s = None, time.monotonic() + READ_ALL_EVERY_S
        try:
            looked_s = await _exchange(farm, ended, limits, looked_s)
            told_away = False
        except Exception as error:
            if not told_away:
                log.warning("nothing is shared with other processes for now", reason=str(error))
            told_away = True
        if not farm.database.is_shared and not told_away:
            return
        await asyncio.sleep(SHARE_EVERY_S)


async def _exchange(farm: Farm, ended: EndedSessions, limits: Limits, looked_s: float | None) -> float:
    """Gives when it looked; ``looked_s`` is when it did so before."""
    now_s = farm.clock.now_s()
    since_s = None if looked_s is None else min(looked_s, now_s) - OVERLAP_S
    async with farm.database.read() as connection:
        for mark, until_s in await all_signed_out(connection, time.time(), since_s):
            ended.add(mark, until_s)
    if farm.database.is_shared:
        await _tell_limits(farm, limits)
    return now_s


async def _tell_limits(farm: Farm, limits: Limits) -> None:
    told = {f"{kind} {name}": count for kind, buckets in limits.by_kind().items() for name, count in buckets.tell().items()}
    if not told:
        return
    async with farm.database.write(lasting=False) as tx:
        totals = await add_asked(tx, told, farm.clock.now_s())
    for kind, buckets in limits.by_kind().items():
        own, everywhere = (
            {name[len(kind) + 1 :]: each[name] for name in each if name.startswith(f"{kind} ")} for each in (told, totals)
        )
        buckets.hear(own, everywhere, time.monotonic())


async def dispatch(settings: Settings) -> None:
    """Gives leases until told to stop, beside processes that answer requests; they share a database on PostgreSQL."""
    if settings.database_url is None or not settings.elsewhere:
        raise NotReady("a dispatcher alone shares a database and a bus; set TRIFARM_DATABASE_URL and --bus-connect")
    async with open_farm(settings) as farm, dispatching(farm, serves=False):
        with _metrics(settings, farm.registry):
            log.info("dispatching", bus=settings.bus_connect, metrics_port=settings.metrics_port)
            log.info("stopping", reason=await told_to_stop())
            end_in_time()


@contextmanager
def _metrics(settings: Settings, registry: CollectorRegistry) -> Iterator[None]:
    """Answers ``/metrics`` of a dispatcher alone, in a thread of its own, where a port was given for it."""
    if settings.metrics_port is None:
        yield
        return
    try:
        server, thread = start_http_server(settings.metrics_port, settings.host, registry)
    except OSError as error:
        raise NotReady(f"nothing can listen on {settings.host}:{settings.metrics_port}, TRIFARM_METRICS_PORT: {error}") from error
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


async def _stop_when_told(server: uvicorn.Server, signals: Signals) -> None:
    log.info("stopping", reason=await told_to_stop())
    end_in_time()
    # Streams of events end first: the server waits for its connections.
    signals.close()
    server.should_exit = True


@asynccontextmanager
async def open_farm(settings: Settings) -> AsyncIterator[Farm]:
    """Opens database and files, brings them up to date, and makes the first tokens.

    Raises:
        NotReady: the folder or the database cannot be used.
    """
    with _named_if_full(settings.data):
        settings.data.mkdir(parents=True, exist_ok=True)
        url = address(settings.truth_url)
        alone = not is_held(settings.data / LOCK)
        with held(settings.data):
            async with _opened(settings, url, alone=alone) as farm:
                yield farm


@contextmanager
def _named_if_full(folder: Path) -> Iterator[None]:
    """Says of a start that a full disk ended which disk it is."""
    try:
        yield
    except (OSError, SQLAlchemyError) as error:
        if not (is_full(error) or is_full_sqlite(error)):
            raise
        raise NotReady(f"the disk of {folder.absolute()} is full; make room there, nothing of the farm is lost") from error


@asynccontextmanager
async def _opened(settings: Settings, url: str, *, alone: bool) -> AsyncIterator[Farm]:
    """Opens the farm; what another process is at in the same folder stays as it is unless this one is ``alone``."""
    await migrate(url)
    database, clock, registry = Database(url), FarmClock.start(), CollectorRegistry()
    ProcessCollector(registry=registry)
    # The folder is this process's own; only what is kept may have another home, which others share.
    files = FileStore(settings.data / "files", open_home(settings))
    if alone:
        files.forget_unfinished()
    if database.is_shared:
        await clock.set_by(database)
    farm = Farm(
        settings=settings,
        database=database,
        files=files,
        policies=Policies(settings, database, files),
        holding=Holding(database, clock, settings.lease_s, settings.max_attempts),
        clock=clock,
        fleet=Fleet(),
        signals=Signals(),
        tokens=Tokens(database, clock),
        registry=registry,
        version=version("trifarm"),
        verifications=asyncio.Semaphore(settings.verification_at_once),
        jail=await asyncio.to_thread(detect),
        key=FarmKey.of(settings.data, None if settings.farm_key is None else settings.farm_key.get_secret_value()),
        disk=Disk(settings.data, settings.disk_reserve_bytes),
        started_at=iso(clock.now_s()),
    )
    try:
        await _first_tokens(settings, farm.tokens)
        all_back = await times_ahead.bring_back(database, clock.now_s(), settings)
        async with database.write() as tx:
            await robots.load(tx, farm.fleet, clock.now_s(), settings.lease_s, prolong=alone and not database.is_shared)
        async with _beside(farm, _ClockFollower(farm, all_back)):
            yield farm
    finally:
        farm.signals.close()
        await database.close()


@asynccontextmanager
async def _beside(farm: Farm, follower: "_ClockFollower") -> AsyncIterator[None]:
    """Runs what goes on beside all requests: the clock follows the database's, large jobs go on, and old logs go."""
    repeated = [_repeat("logs were not tidied", TIDY_EVERY_S, lambda: _tidy(farm))]
    if farm.settings.dispatches:
        large = LargeJobs(farm.database, farm.clock, farm.signals, farm.settings.trials_page)
        repeated.append(_repeat("large jobs did not go on", large_jobs.LOOK_EVERY_S, large.look))
    if farm.database.is_shared:
        repeated.append(_repeat("the clock was not set", FOLLOW_EVERY_S, follower.follow))
    repeated.append(_repeat("why a trial failed was not computed", explainer.LOOK_EVERY_S, _explainer(farm).explain_due))
    if farm.settings.webhooks:
        calls = Deliverer(farm.settings.farm, farm.database, farm.clock, farm.fleet, farm.key)
        repeated.append(_call_webhooks(calls))
    running = [asyncio.create_task(each) for each in repeated]
    try:
        yield
    finally:
        for each in running:
            each.cancel()
        await asyncio.wait(running)


def _explainer(farm: Farm) -> explainer.Explainer:
    settings = farm.settings
    return explainer.Explainer(farm.database, farm.files, farm.clock, settings.jail_level, settings.why_deadline_s)


async def _call_webhooks(calls: Deliverer) -> None:
    try:
        await _repeat("webhooks were not called", LOOK_EVERY_S, calls.deliver)
    finally:
        await calls.end()


async def _repeat(failed: str, every_s: float, work: Callable[[], Awaitable[object]]) -> None:
    while True:
        await asyncio.sleep(every_s)
        try:
            await work()
        except (OSError, SQLAlchemyError, ServiceError) as error:
            log.warning(failed, reason=str(error))
        except Exception:
            # What is repeated must outlive any single failure; the next time tries again.
            log.exception(failed)


@dataclass
class _ClockFollower:
    """Sets the clock by the database's; owns whether all times were brought back since it went back, or some still have to be."""

    farm: Farm
    all_back: bool = True

    async def follow(self) -> None:
        farm = self.farm
        if back_s := await farm.clock.set_by(farm.database):
            log.warning("the database's clock went back", seconds=round(back_s, 1))
            farm.fleet.went_back(farm.clock.now_s())
            self.all_back = False
        if not self.all_back:
            self.all_back = await times_ahead.bring_back(farm.database, farm.clock.now_s(), farm.settings)


async def _tidy(farm: Farm) -> None:
    rules = Rules(farm.settings.keep_logs_days, farm.settings.keep_logs_bytes)
    async with farm.database.write(lasting=False) as tx:
        await forget_old(tx, time.time())
    removed = await retention.tidy(farm.database, farm.files, rules, time.time())
    if removed.files:
        log.info("old logs removed", files=removed.files, bytes=removed.bytes)


@asynccontextmanager
async def dispatching(farm: Farm, *, serves: bool = True) -> AsyncIterator[Dispatcher]:
    """Opens the bus and runs the dispatcher beside whatever the block does; ``serves`` says whether that takes in files."""
    settings = farm.settings
    bus = await Bus.open(session_config(settings, farm.key), settings.farm)
    metrics = Metrics.register(farm.registry, dispatches=settings.dispatches)
    # A dispatcher alone keeps nothing in its folder.
    disk = Disk(settings.data, settings.disk_reserve_bytes if serves else 0)
    dispatcher = Dispatcher(settings, farm.database, bus, farm.clock, farm.fleet, farm.signals, metrics, disk, serves)
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
            try:
                await tokens.register(bearer.get_secret_value(), request)
            except IntegrityError:
                await tokens.register(bearer.get_secret_value(), request)  # another process did so at the same time
    if any(bearer is not None for bearer, _ in given) or await tokens.any():
        return
    # The file first: of tokens that are in the database alone nobody knows the secrets, and no others would be made.
    made = {"admin": new_bearer(), "robot": new_bearer()}
    _write_privately(settings.data / TOKENS_FILE, json.dumps(made))
    await tokens.keep({made["admin"]: ADMIN, made["robot"]: ROBOT})


def _write_privately(path: Path, text: str) -> None:
    unfinished = path.with_suffix(".new")
    unfinished.unlink(missing_ok=True)
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text)
    put_in_place(unfinished, path)
