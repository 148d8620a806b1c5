"""The file store: write-once objects named by the SHA-256 of their content, in a local folder."""

import asyncio
import hashlib
import os
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import obstore
from obstore.exceptions import AlreadyExistsError
from obstore.store import LocalStore

from services.errors import Refused, TooLarge

SPOOL_BYTES = 1024 * 1024
"""How much is gathered before a thread hashes and writes it: small enough for memory, large enough to be worth the hop."""
READ_BYTES = 256 * 1024
INCOMING = "incoming"


@dataclass(frozen=True)
class Stored:
    """An object of the store; ``new`` is false when it was there before."""

    sha256: str
    size: int
    new: bool


class FileStore:
    """Content-addressed files below one folder; owns that folder."""

    def __init__(self, root: Path) -> None:
        self._root = root
        (root / INCOMING).mkdir(parents=True, exist_ok=True)
        self._store = LocalStore(root)

    async def put(
        self, chunks: AsyncIterator[bytes], *, limit_bytes: int, expected_sha256: str | None = None, durable: bool = False
    ) -> Stored:
        """Streams a body to disk while hashing it, then gives it its name, which can be done once only.

        Args:
            chunks: the content.
            limit_bytes: the most that is taken.
            expected_sha256: what the sender said it is.
            durable: wait until the disk has it; for what was acknowledged and cannot be made again.

        Raises:
            TooLarge: more than ``limit_bytes``.
            Refused: the content is not what the sender said.
        """
        spool = self._root / INCOMING / secrets.token_hex(12)
        try:
            sha256, size = await _spool(spool, chunks, limit_bytes, durable=durable)
            if expected_sha256 not in (None, sha256):
                raise Refused(
                    "content-mismatch", f"The body's SHA-256 is {sha256}, not {expected_sha256} as announced; send again."
                )
            new = await self._name(spool, sha256)
            if durable:
                await asyncio.to_thread(_sync_folder, (self._root / _key(sha256)).parent)
            return Stored(sha256, size, new)
        finally:
            spool.unlink(missing_ok=True)

    async def put_file(self, path: Path, *, durable: bool = False) -> Stored:
        """Takes a copy of a local file."""
        size = await asyncio.to_thread(lambda: path.stat().st_size)
        return await self.put(_read(path), limit_bytes=size, durable=durable)

    async def size(self, sha256: str) -> int | None:
        """Bytes of an object; None when it is not there."""
        try:
            return (await obstore.head_async(self._store, _key(sha256)))["size"]
        except FileNotFoundError:
            return None

    async def read(self, sha256: str, start: int = 0, end: int | None = None) -> AsyncIterator[bytes]:
        """The bytes from ``start`` up to, not including, ``end``.

        Raises:
            FileNotFoundError: there is no such object.
        """
        stop = await self.size(sha256) if end is None else end
        if stop is None:
            raise FileNotFoundError(sha256)
        if stop <= start:
            return
        found = await obstore.get_async(self._store, _key(sha256), options={"range": (start, stop)})
        async for chunk in found.stream(READ_BYTES):
            yield bytes(chunk)

    def forget_unfinished(self) -> int:
        """Removes what a killed process left half written; gives how many files. Call when no upload can be under way."""
        left = list((self._root / INCOMING).iterdir())
        for path in left:
            path.unlink()
        return len(left)

    async def _name(self, spool: Path, sha256: str) -> bool:
        try:
            source = f"{INCOMING}/{spool.name}"
            await obstore.rename_async(self._store, source, _key(sha256), overwrite=False)
        except AlreadyExistsError:
            return False
        return True


def _key(sha256: str) -> str:
    return f"sha256/{sha256[:2]}/{sha256}"


async def _spool(path: Path, chunks: AsyncIterator[bytes], limit_bytes: int, *, durable: bool) -> tuple[str, int]:
    hashed, size, gathered, gathered_bytes = hashlib.sha256(), 0, [], 0
    with path.open("xb", buffering=0) as file:
        async for chunk in chunks:
            size += len(chunk)
            if size > limit_bytes:
                raise TooLarge("file-too-large", f"The file is larger than the {limit_bytes} bytes that are taken.")
            gathered.append(chunk)
            gathered_bytes += len(chunk)
            if gathered_bytes >= SPOOL_BYTES:
                await asyncio.to_thread(_take, hashed, file, gathered)
                gathered, gathered_bytes = [], 0
        await asyncio.to_thread(_take, hashed, file, gathered)
        if durable:
            await asyncio.to_thread(os.fsync, file.fileno())
    return hashed.hexdigest(), size


def _take(hashed: "hashlib._Hash", file: BinaryIO, chunks: list[bytes]) -> None:
    for chunk in chunks:
        hashed.update(chunk)
        view = memoryview(chunk)
        while view:
            view = view[file.write(view) :]


def _sync_folder(folder: Path) -> None:
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


async def _read(path: Path) -> AsyncIterator[bytes]:
    with path.open("rb") as file:
        while chunk := await asyncio.to_thread(file.read, SPOOL_BYTES):
            yield chunk
