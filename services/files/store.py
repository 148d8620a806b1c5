"""The file store: write-once objects named by the SHA-256 of their content, in a local folder or on S3."""

import asyncio
import hashlib
import secrets
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO
from weakref import WeakValueDictionary

import obstore
import structlog
from obstore.exceptions import GenericError, PermissionDeniedError, UnauthenticatedError

from services.errors import DISK_FULL, Refused, TooLarge, Unavailable
from services.files.homes import FileHome, LocalHome
from trial_logs.disk import is_full

if TYPE_CHECKING:
    from obstore import ObjectMeta

log = structlog.get_logger()

SPOOL_BYTES = 1024 * 1024
"""How much is gathered before a thread hashes and writes it: small enough for memory, large enough to be worth the hop."""
READ_BYTES = 256 * 1024
INCOMING = "incoming"
OBJECTS = "sha256"


@dataclass(frozen=True)
class Stored:
    """An object of the store; ``new`` is false when it was there before."""

    sha256: str
    size: int
    new: bool


@dataclass(frozen=True)
class Kept:
    """An object as the store lists it; ``stored_s`` is when it came, in seconds since 1970 of the store's clock."""

    sha256: str
    size: int
    stored_s: float


class FileStore:
    """Content-addressed files; owns the folder that uploads are gathered in, and everything in its home."""

    def __init__(self, root: Path, home: FileHome | None = None) -> None:
        """Opens the store.

        Args:
            root: the folder whose ``incoming`` uploads are gathered in.
            home: where they are kept; without one below the same folder.
        """
        self._root = root
        (root / INCOMING).mkdir(parents=True, exist_ok=True)
        self._home = LocalHome(root) if home is None else home
        self._names: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    async def put(self, chunks: AsyncIterator[bytes], *, limit_bytes: int, expected_sha256: str | None = None) -> Stored:
        """Streams a body to disk while hashing it, then gives it its name; when that is done, a power cut does not take it.

        Args:
            chunks: the content.
            limit_bytes: the most that is taken.
            expected_sha256: what the sender said it is.

        Raises:
            TooLarge: more than ``limit_bytes``.
            Refused: the content is not what the sender said.
            Unavailable: the disk is full, or the home of the files does not answer.
        """
        spool = self._root / INCOMING / secrets.token_hex(12)
        try:
            sha256, size = await _spool(spool, chunks, limit_bytes)
            if expected_sha256 not in (None, sha256):
                raise Refused(
                    "content-mismatch", f"The body's SHA-256 is {sha256}, not {expected_sha256} as announced; send again."
                )
            async with self._name(sha256):
                with _away_if_unreachable():
                    new = await self._home.take(spool, _key(sha256))
            return Stored(sha256, size, new)
        except OSError as error:
            if not is_full(error):
                raise
            log.error("disk full", reason=str(error))
            raise Unavailable("disk-full", DISK_FULL) from error
        finally:
            spool.unlink(missing_ok=True)

    async def put_file(self, path: Path) -> Stored:
        """Takes a copy of a local file."""
        size = await asyncio.to_thread(lambda: path.stat().st_size)
        return await self.put(_read(path), limit_bytes=size)

    async def size(self, sha256: str) -> int | None:
        """Bytes of an object; None when it is not there."""
        found = await self.find(sha256)
        return None if found is None else found.size

    async def find(self, sha256: str) -> Kept | None:
        """An object as it is now; None when it is not there."""
        try:
            with _away_if_unreachable():
                return _kept(await obstore.head_async(self._home.objects, _key(sha256)))
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
        with _away_if_unreachable():
            found = await obstore.get_async(self._home.objects, _key(sha256), options={"range": (start, stop)})
            async for chunk in found.stream(READ_BYTES):
                yield bytes(chunk)

    async def all(self) -> AsyncIterator[Kept]:
        """Every object of the store."""
        with _away_if_unreachable():
            async for page in obstore.list(self._home.objects, prefix=OBJECTS):
                for each in page:
                    yield _kept(each)

    async def remove(self, sha256: str) -> None:
        """Takes an object out of the store for good; one that is not there is no error."""
        with _away_if_unreachable(), suppress(FileNotFoundError):
            await obstore.delete_async(self._home.objects, _key(sha256))

    async def remove_if_unchanged(self, known: Kept) -> bool:
        """Removes an object that has not come again since it was listed; gives whether it did.

        What comes at this moment comes before, and the object stays, or afterwards, and is stored anew.
        """
        async with self._name(known.sha256):
            found = await self.find(known.sha256)
            if found is None or found.stored_s != known.stored_s:
                return False
            await self.remove(known.sha256)
            return True

    def _name(self, sha256: str) -> asyncio.Lock:
        """Held by whoever gives this name to an object, or takes it away."""
        return self._names.setdefault(sha256, asyncio.Lock())

    def forget_unfinished(self) -> int:
        """Removes what a killed process left half written; gives how many files. Call when no upload can be under way."""
        left = list((self._root / INCOMING).iterdir())
        for path in left:
            path.unlink()
        return len(left)


@contextmanager
def _away_if_unreachable() -> Iterator[None]:
    """What S3 could not do for us, after several tries, as the error that says so to whoever asked."""
    try:
        yield
    except (GenericError, PermissionDeniedError, UnauthenticatedError) as error:
        log.error("file store unreachable", reason=str(error))
        raise Unavailable("files-unavailable", "The file store did not answer; try again in a moment.") from error


def _kept(found: "ObjectMeta") -> Kept:
    return Kept(found["path"].rpartition("/")[2], found["size"], found["last_modified"].timestamp())


def _key(sha256: str) -> str:
    return f"{OBJECTS}/{sha256[:2]}/{sha256}"


async def _spool(path: Path, chunks: AsyncIterator[bytes], limit_bytes: int) -> tuple[str, int]:
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
    return hashed.hexdigest(), size


def _take(hashed: "hashlib._Hash", file: BinaryIO, chunks: list[bytes]) -> None:
    for chunk in chunks:
        hashed.update(chunk)
        view = memoryview(chunk)
        while view:
            view = view[file.write(view) :]


async def _read(path: Path) -> AsyncIterator[bytes]:
    with path.open("rb") as file:
        while chunk := await asyncio.to_thread(file.read, SPOOL_BYTES):
            yield chunk
