"""Where files are kept: a local folder or a bucket of an S3 server; each gives a file its name once only."""

import asyncio
import hashlib
import os
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import obstore
import structlog
from obstore.exceptions import AlreadyExistsError
from obstore.store import LocalStore, ObjectStore, S3Store

from services.errors import NotReady
from services.settings import Settings
from trial_logs.disk import sync

if TYPE_CHECKING:
    from obstore.store import ClientConfig, RetryConfig, S3Config

log = structlog.get_logger()
IN_ONE_PIECE_BYTES = 32 * 1024**2
"""Larger files go to S3 in parts, so that none has to be in memory as a whole."""
PART_BYTES = 8 * 1024**2
PARTS_AT_ONCE = 4
TRIES: "RetryConfig" = {"max_retries": 5, "retry_timeout": timedelta(seconds=20)}


class FileHome(Protocol):
    """Keeps whole files under keys."""

    @property
    def objects(self) -> ObjectStore:
        """What the files are read from."""
        ...

    async def take(self, file: Path, key: str) -> bool:
        """Keeps the file under the key, so that a power cut does not take it.

        False when it was there already, whole; its age is counted from now on all the same.
        """
        ...


class LocalHome:
    """A folder; files get a second name in it, so they must be on the same disk."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._on_disk: set[Path] = set()
        self.objects: ObjectStore = LocalStore(root)

    async def take(self, file: Path, key: str) -> bool:
        """Gives the file a second name, and waits until the disk has both; what a power cut damaged is replaced."""
        return await asyncio.to_thread(self._take, file, self._root / key)

    def _take(self, file: Path, place: Path) -> bool:
        sync(file)
        place.parent.mkdir(parents=True, exist_ok=True)
        new = True
        try:
            place.hardlink_to(file)  # only where there is none; the one who called removes the other name
        except FileExistsError:
            if new := not _renew(place):
                log.warning("a damaged file is replaced", key=str(place.relative_to(self._root)))
                file.replace(place)
        self._sync_name(place)
        return new

    def _sync_name(self, place: Path) -> None:
        """Syncs the folder of a file, and once in the life of this process those that hold this folder's own name."""
        sync(place.parent)
        if place.parent not in self._on_disk:
            for folder in place.parent.relative_to(self._root).parents:
                sync(self._root / folder)
            self._on_disk.add(place.parent)


class S3Home:
    """A bucket, or what lies in it under a prefix."""

    def __init__(self, objects: S3Store) -> None:
        self.objects: ObjectStore = objects

    async def take(self, file: Path, key: str) -> bool:
        """Uploads the file; what the server has acknowledged is durable.

        S3 puts a whole object only where there is none; for one in parts it cannot promise that. The key is the hash of the
        content, so that the second of two at the same time writes what is there already. What is there is put again, because
        nothing else makes it young.
        """
        if await asyncio.to_thread(lambda: file.stat().st_size) <= IN_ONE_PIECE_BYTES:
            try:
                await obstore.put_async(self.objects, key, file, mode="create", use_multipart=False)
                return True
            except AlreadyExistsError:
                await obstore.put_async(self.objects, key, file, use_multipart=False)
                return False
        new = not await self._has(key)
        await obstore.put_async(self.objects, key, file, use_multipart=True, chunk_size=PART_BYTES, max_concurrency=PARTS_AT_ONCE)
        return new

    async def _has(self, key: str) -> bool:
        try:
            await obstore.head_async(self.objects, key)
        except FileNotFoundError:
            return False
        return True


def open_home(settings: Settings) -> FileHome | None:
    """The home that the settings name; None where the data folder is it.

    Raises:
        NotReady: it is neither on S3 nor none at all.
    """
    if settings.files_url is None:
        return None
    if not settings.files_url.startswith("s3://"):
        raise NotReady(f"the files are to be in {settings.files_url}; give s3://bucket/prefix, or none for the data folder")
    return S3Home(
        S3Store.from_url(settings.files_url, config=_s3_config(settings), client_options=_waits(settings), retry_config=TRIES)
    )


def _s3_config(settings: Settings) -> "S3Config":
    config: S3Config = {"region": settings.s3_region}
    if settings.s3_endpoint is not None:
        config["endpoint"] = settings.s3_endpoint
    if settings.s3_access_key_id is not None:
        config["access_key_id"] = settings.s3_access_key_id
    if settings.s3_secret_access_key is not None:
        config["secret_access_key"] = settings.s3_secret_access_key.get_secret_value()
    return config


def _waits(settings: Settings) -> "ClientConfig":
    without_tls = (settings.s3_endpoint or "").startswith("http://")
    return {"connect_timeout": "5s", "timeout": "60s", "allow_http": without_tls}


def _renew(place: Path) -> bool:
    """Makes a file as young as one that has just come; false when it is not what its name, a SHA-256, says."""
    try:
        with place.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != place.name:
                return False
        os.utime(place)
        return True
    except FileNotFoundError:
        return False
