"""Real homes of truth and files for tests: a PostgreSQL server and an S3 server, one of each for a whole run.

Where a program is missing, its tests are skipped and say so; ``make homes`` installs both.
"""

import asyncio
import itertools
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import asyncpg
import httpx
import pytest

from services.database.database import migrate
from services.database.tables import metadata
from services.settings import Settings
from tests.integration.farm_process import free_port

NOBODY = 65534
TOOLS = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "trifarm" / "bin"
S3_KEYS = {"s3_access_key_id": "tests", "s3_secret_access_key": "tests-secret"}
QUICK = ("-c", "fsync=off", "-c", "full_page_writes=off", "-c", "max_connections=200", "-c", "shared_buffers=64MB")
"""A server for tests: what it holds need not outlive a power cut."""


@dataclass
class Postgres:
    """A running server; each test takes a database of its own."""

    port: int
    folder: Path
    command: list
    more: dict
    process: subprocess.Popen | None = None
    numbers: Iterator[int] = field(default_factory=itertools.count)

    def start(self):
        """Starts the server, also again."""
        with (self.folder / "log").open("ab") as errors:
            self.process = subprocess.Popen(self.command, stderr=errors, **self.more)
        _wait(lambda: now(self.run("SELECT 1")), self.process, self.folder / "log")

    def stop(self):
        """Ends it at once, as a crash would."""
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait(60)

    def url(self, name):
        return f"postgresql+asyncpg://postgres@127.0.0.1:{self.port}/{name}"

    async def run(self, statement, name="postgres"):
        connection = await asyncpg.connect(self.url(name).replace("+asyncpg", ""))
        try:
            return await connection.fetch(statement)
        finally:
            await connection.close()

    def make_newest(self):
        """The template of new databases."""
        now(self.run("CREATE DATABASE newest TEMPLATE template0"))
        now(migrate(self.url("newest")))

    async def empty(self):
        """The address of a new database without tables."""
        name = f"empty{next(self.numbers)}"
        await self.run(f"CREATE DATABASE {name} TEMPLATE template0")
        return self.url(name)

    async def new(self):
        """The address of a new database in the newest form."""
        name = f"farm{next(self.numbers)}"
        await self.run(f"CREATE DATABASE {name} TEMPLATE newest")
        return self.url(name)

    async def cleared(self):
        """The address of the one that tests take one after the other, as good as new and ready sooner."""
        if not await self.run("SELECT 1 FROM pg_database WHERE datname = 'cleared'"):
            await self.run("CREATE DATABASE cleared TEMPLATE newest")
        names = ", ".join(table.name for table in metadata.sorted_tables)
        await self.run(f"TRUNCATE {names} RESTART IDENTITY", "cleared")
        return self.url("cleared")


def now(work):
    """Runs a coroutine to its end, also where a loop is running already."""
    with ThreadPoolExecutor(1) as other:
        return other.submit(asyncio.run, work).result()


def program(name):
    """Where a program is; None where it is not installed."""
    found = shutil.which(name, path=f"{TOOLS}:{os.environ.get('PATH', '')}")
    debian = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: int(path.parts[-3]))
    return found or (str(debian[-1]) if debian else None)


@contextmanager
def postgres_server(*options):
    """A server in a new folder, run by somebody without rights: as root it refuses to start."""
    initdb, server = program("initdb"), program("postgres")
    if initdb is None or server is None:
        pytest.skip("PostgreSQL is not installed (no initdb, no postgres); 'make homes' installs it")
    who = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}
    folder = Path(tempfile.mkdtemp(prefix="trifarm-postgres-", dir="/tmp"))
    try:
        if who:
            os.chown(folder, NOBODY, NOBODY)
        quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "env": {"PATH": os.environ["PATH"], "LC_ALL": "C.UTF-8"}}
        made = [os.path.realpath(initdb), "-D", "data", "-U", "postgres", "--auth=trust", "--no-sync", "-E", "UTF8"]
        subprocess.run(made, check=True, **quiet, **who)
        port = free_port()
        place = ("-c", "listen_addresses=127.0.0.1", "-c", f"port={port}", "-c", f"unix_socket_directories={folder}")
        running = Postgres(port, folder, [os.path.realpath(server), "-D", "data", *place, *options], quiet | who)
        try:
            running.start()
            yield running
        finally:
            running.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def s3_server():
    """An S3 server over a new folder: (its address, a function that makes a bucket)."""
    gateway = program("versitygw")
    if gateway is None:
        pytest.skip(f"no S3 server is installed (versitygw, in {TOOLS}); 'make homes' installs it")
    with tempfile.TemporaryDirectory(prefix="trifarm-s3-") as name:
        port, folder = free_port(), Path(name)
        keys = ("--access", S3_KEYS["s3_access_key_id"], "--secret", S3_KEYS["s3_secret_access_key"])
        command = [gateway, "--quiet", "--port", f"127.0.0.1:{port}", *keys, "posix", name]
        with (folder.parent / f"{folder.name}.log").open("wb") as said:
            process = subprocess.Popen(command, stdout=said, stderr=said)
        try:
            _wait(lambda: httpx.get(f"http://127.0.0.1:{port}/"), process, Path(said.name))
            yield S3(f"http://127.0.0.1:{port}", folder, process)
        finally:
            process.kill()
            process.wait()
            Path(said.name).unlink()


@dataclass
class S3:
    """A running server; each test takes a bucket of its own."""

    endpoint: str
    folder: Path
    process: subprocess.Popen
    numbers: Iterator[int] = field(default_factory=itertools.count)

    def settings(self):
        """Settings of a new bucket."""
        name = f"bucket{next(self.numbers)}"
        (self.folder / name).mkdir()
        return {"files_url": f"s3://{name}/files", "s3_endpoint": self.endpoint} | S3_KEYS


def _wait(answers, process, log, within_s=120):
    ends = time.monotonic() + within_s
    while time.monotonic() < ends:
        assert process.poll() is None, log.read_text()
        with suppress(OSError, httpx.TransportError, asyncpg.PostgresError):
            answers()
            return
        time.sleep(0.05)
    raise AssertionError(f"no answer within {within_s} s: {log.read_text()}")


@pytest.fixture(scope="session")
def postgres():
    with postgres_server(*QUICK) as running:
        running.make_newest()
        yield running


@pytest.fixture(scope="session")
def s3():
    with s3_server() as running:
        yield running


def scale_settings(postgres, s3):
    """What a services process is told whose homes are these two servers."""
    return {"database_url": now(postgres.new())} | s3.settings()


def s3_home_settings(s3, **more):
    return Settings(**s3.settings(), **more)
