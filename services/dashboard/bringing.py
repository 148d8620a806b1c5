"""Brings a log from the store to a folder: whole, or of a large one only the parts that are drawn, in a file with holes."""

import asyncio
import json
import struct
import tempfile
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import BinaryIO

from services.dashboard.partial import MOST_PACKED_BYTES, WHOLE_BYTES, Span
from services.files.store import FileStore

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<BQQQI8s")
"""The last record of an MCAP file and what follows it: opcode, length, where the summary begins, its offsets, its sum, magic."""
FOOTER_OPCODE = 2
MOST_SUMMARY_BYTES = 16 * 1024**2
HEAD_BYTES = 4096
MOST_SPANS = 20_000


class UnreadableError(Exception):
    """The file is no log of which a part could be read."""


async def bring(files: FileStore, sha256: str, size: int, path: Path, ask: Callable[[Path], Awaitable[bytes]]) -> int:
    """Writes a log, or of a large one its drawn parts at their places; gives how many bytes were read of the store.

    Args:
        files: where it is.
        sha256: which it is.
        size: of it.
        path: the file to make.
        ask: has a jailed process read the summary of a file, and gives the byte ranges that it wants as a JSON list of pairs.

    Raises:
        UnreadableError: it has no summary, or one that asks for too much.
    """
    with path.open("xb") as file:
        if size <= WHOLE_BYTES:
            return await _copy(files, sha256, (0, size), file)
        known = [(0, await _read(files, sha256, 0, HEAD_BYTES)), await _ending(files, sha256, size)]
        # A folder of its own: what the process leaves in it is not looked at, and nothing is written behind it.
        with tempfile.TemporaryDirectory(prefix="trifarm-summary-") as name:
            summary = Path(name) / path.name
            with summary.open("xb") as asked:
                _put(asked, known, size)
            wanted = spans(await ask(summary), size)
        _put(file, known, size)
        return sum(len(part) for _, part in known) + sum([await _copy(files, sha256, each, file) for each in wanted])


async def _ending(files: FileStore, sha256: str, size: int) -> tuple[int, bytes]:
    """Where the summary begins, and all from there on."""
    opcode, _, begins, _, _, magic = FOOTER.unpack(await _read(files, sha256, size - FOOTER.size, size))
    if opcode != FOOTER_OPCODE or magic != MAGIC or not 0 < begins < size or size - begins > MOST_SUMMARY_BYTES:
        raise UnreadableError("the log has no summary, or too large a one")
    return begins, await _read(files, sha256, begins, size)


async def _read(files: FileStore, sha256: str, start: int, end: int) -> bytes:
    return b"".join([chunk async for chunk in files.read(sha256, start, end)])


def _put(file: BinaryIO, parts: Sequence[tuple[int, bytes]], size: int) -> None:
    """Makes a file of the whole size with some parts at their places; the rest takes no room."""
    file.truncate(size)
    for start, content in parts:
        file.seek(start)
        file.write(content)


def spans(told: bytes, size: int) -> list[Span]:
    """The ranges that the jailed process asked for, which may be anything if the log had won it over.

    Raises:
        UnreadableError: they are no ranges of the file, or more than is read of a log.
    """
    try:
        found = [(int(start), int(end)) for start, end in json.loads(told)]
    except (ValueError, TypeError) as error:
        raise UnreadableError("no ranges were asked for") from error
    total = sum(end - start for start, end in found)
    if len(found) > MOST_SPANS or total > 2 * MOST_PACKED_BYTES or not all(0 <= start < end <= size for start, end in found):
        raise UnreadableError(f"{len(found)} ranges with {total} bytes of a file of {size} are not read")
    return found


async def _copy(files: FileStore, sha256: str, span: Span, file: BinaryIO) -> int:
    """Copies a range to its place; gives its length."""
    start, end = span
    file.seek(start)
    async for chunk in files.read(sha256, start, end):
        await asyncio.to_thread(file.write, chunk)
    return end - start
