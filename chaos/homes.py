"""The two homes of a farm that is broken: SQLite and a folder, or a PostgreSQL server and an S3 server that the run starts."""

import os
import secrets
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

import httpx

from chaos.processes import Process, free_port, until

EMBEDDED, SCALE = "embedded", "scale"
NOBODY = 65534
BUCKET = "farm"
TOOLS = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "trifarm" / "bin"
SERVER_OPTIONS = ("max_connections=120", "shared_buffers=32MB", "min_wal_size=32MB", "max_wal_size=64MB", "wal_keep_size=0")
DATABASE_UP_WITHIN_S = 60


class HomeMissing(Exception):
    """A program that the home needs is not installed; the message says which and what installs it."""


def find_program(name: str) -> str:
    """Where a program is.

    Raises:
        HomeMissing: nowhere.
    """
    versions = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: int(path.parts[-3]))
    found = str(versions[-1]) if versions else shutil.which(name, path=f"{TOOLS}{os.pathsep}{os.environ.get('PATH', '')}")
    if found is None:
        raise HomeMissing(f"{name} is not installed; 'make homes' installs what the home '{SCALE}' needs")
    return os.path.realpath(found)


@dataclass
class ScaleHome:
    """The two servers of a farm past one machine, with what the services are told of them."""

    database: Process
    files: Process
    settings: dict[str, str]

    def start(self) -> None:
        """Starts both; they answer when this returns."""
        self.start_database()
        self.files.start()
        address = self.settings["TRIFARM_S3_ENDPOINT"]
        until(lambda: _answers(address), 30, f"an answer of the S3 server: {self.files.said()}")

    def start_database(self) -> float:
        """Starts the database, also again; gives after how many seconds it answered."""
        (Path(str(self.database.options["cwd"])) / "data" / "postmaster.pid").unlink(missing_ok=True)
        self.database.start()
        asks = [
            find_program("pg_isready"),
            "-q",
            "-h",
            "127.0.0.1",
            "-p",
            self.settings["TRIFARM_DATABASE_URL"].split(":")[-1].split("/")[0],
        ]
        return until(
            lambda: subprocess.run(asks, check=False, capture_output=True).returncode == 0,
            DATABASE_UP_WITHIN_S,
            "an answer of PostgreSQL",
            every_s=0.1,
        )

    def stop_database(self) -> None:
        """Ends it at once, as a crash would: SIGQUIT is PostgreSQL's word for that."""
        self.database.send(signal.SIGQUIT)
        if self.database.running is not None:
            self.database.running.wait(15)


def scale_home(folder: Path, logs: Path, processes: dict[str, Process]) -> ScaleHome:
    """Makes a PostgreSQL cluster and a bucket in the folder; nothing runs yet.

    Raises:
        HomeMissing: PostgreSQL or versitygw is not installed.
    """
    initdb, server, gateway = (find_program(name) for name in ("initdb", "postgres", "versitygw"))
    place, bucket = folder / "postgres", folder / "s3" / BUCKET
    bucket.mkdir(parents=True)
    place.mkdir(mode=0o700)
    who: dict[str, object] = {}
    password, written = secrets.token_hex(16), place / "password"  # other users of the machine reach the port, too
    written.touch(0o600)
    written.write_text(password)
    if os.geteuid() == 0:  # PostgreSQL refuses to run as root
        for each in (place, written):
            os.chown(each, NOBODY, NOBODY)
        who = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
    made = [initdb, "-D", "data", "-U", "postgres", "--auth=scram-sha-256", "--pwfile=password", "--no-sync", "-E", "UTF8"]
    subprocess.run(made, check=True, cwd=place, stdout=subprocess.DEVNULL, env={"LC_ALL": "C.UTF-8"}, **who)  # type: ignore[arg-type]
    written.unlink()
    port, s3_port = free_port(), free_port()
    flags = [part for each in (*SERVER_OPTIONS, f"port={port}", "listen_addresses=127.0.0.1") for part in ("-c", each)]
    command = [server, "-D", "data", *flags, "-c", f"unix_socket_directories={place}"]
    key, secret = "chaos", secrets.token_hex(16)
    stores = [
        gateway,
        "--quiet",
        "--port",
        f"127.0.0.1:{s3_port}",
        "--access",
        key,
        "--secret",
        secret,
        "posix",
        str(bucket.parent),
    ]
    processes["postgres"] = Process("postgres", command, {}, logs / "postgres.log", {"cwd": place} | who)
    processes["s3"] = Process("s3", stores, {"HOME": str(folder)}, logs / "s3.log", {"cwd": folder})
    settings = {
        "TRIFARM_DATABASE_URL": f"postgresql://postgres:{password}@127.0.0.1:{port}/postgres",
        "TRIFARM_FILES_URL": f"s3://{BUCKET}/files",
        "TRIFARM_S3_ENDPOINT": f"http://127.0.0.1:{s3_port}",
        "TRIFARM_S3_ACCESS_KEY_ID": key,
        "TRIFARM_S3_SECRET_ACCESS_KEY": secret,
    }
    return ScaleHome(processes["postgres"], processes["s3"], settings)


def _answers(address: str) -> bool:
    try:
        httpx.get(address, trust_env=False)
    except httpx.TransportError:
        return False
    return True
