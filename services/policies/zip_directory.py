"""The directory of a zip archive, read by hand within limits before anything is inflated: what it lists, what is refused.

Only archives whose every byte belongs to exactly one entry or to the directory pass, so that no two readers can see two contents.
"""

import stat
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

from services.policies.unfit import UnfitError

END = struct.Struct("<4s4H2IH")
END64 = struct.Struct("<4sQ2H2I4Q")
LOCATOR64 = struct.Struct("<4sIQI")
CENTRAL = struct.Struct("<4s6H3I5H2I")
LOCAL = struct.Struct("<4s5H3I2H")
COMMENT_LIMIT_BYTES = 65535
NAME_LIMIT_BYTES = 200
STORED, DEFLATED = 0, 8
ENCRYPTED_FLAGS = 0x2041
"""Encryption, strong encryption, and an encrypted directory."""
DESCRIPTOR_FLAG = 0x8
DESCRIPTOR_LIMIT_BYTES = 24
RATIO_LIMIT = 100
FREE_BYTES = 64 * 1024
"""An entry of no more than this may have any ratio."""
FULL = 0xFFFFFFFF


@dataclass(frozen=True)
class Entry:
    """A file of the archive; ``begin`` is where its bytes begin in the archive."""

    name: str
    method: int
    begin: int
    packed_bytes: int
    plain_bytes: int
    crc: int


def read_directory(content: memoryview, *, entry_limit: int, plain_limit_bytes: int) -> dict[str, Entry]:
    """The entries of an archive by name.

    Args:
        content: the whole archive.
        entry_limit: how many entries are taken.
        plain_limit_bytes: how many bytes the entries may have together once inflated, by what the directory says.

    Raises:
        UnfitError: it is not a plain zip archive of plain files, or is over a limit.
    """
    count, start, end = _directory(content, entry_limit)
    entries, spans = [], []
    at = start
    for _ in range(count):
        entry, header_at, at = _central(content, at, end)
        entries.append(entry)
        spans.append((header_at, entry))
    if at != end:
        raise _broken("its directory is longer than its entries")
    _check_names(entries)
    _check_sizes(entries, plain_limit_bytes)
    return {entry.name: entry for entry in _with_begin(content, sorted(spans, key=lambda each: each[0]), start)}


def inflate(content: memoryview, entry: Entry) -> memoryview:
    """The bytes of an entry, never more than the directory said.

    Raises:
        UnfitError: they are fewer, more, or not the ones that were packed.
    """
    packed = content[entry.begin : entry.begin + entry.packed_bytes]
    if entry.method == STORED:
        plain = packed
    else:
        reader = zlib.decompressobj(-zlib.MAX_WBITS)
        try:
            plain = memoryview(reader.decompress(packed, entry.plain_bytes + 1))
        except zlib.error as error:
            raise _broken(f"it cannot be inflated ({error})", entry.name) from error
        if len(plain) != entry.plain_bytes or not reader.eof or reader.unused_data:
            raise _broken(f"it does not have the {entry.plain_bytes} bytes that the directory says", entry.name)
    if zlib.crc32(plain) != entry.crc:
        raise _broken("its checksum is wrong", entry.name)
    return plain


def _directory(content: memoryview, entry_limit: int) -> tuple[int, int, int]:
    """Number of entries, first byte of the directory and the byte behind it."""
    tail_at = max(0, len(content) - END.size - COMMENT_LIMIT_BYTES)
    tail = bytes(content[tail_at:])
    found = tail.rfind(b"PK\x05\x06")
    if found < 0 or len(tail) - found < END.size:
        raise _broken("it has no directory at its end, perhaps cut short")
    _, disk, first_disk, here, count, size, start, comment = END.unpack_from(tail, found)
    at = tail_at + found
    if at + END.size + comment != len(content):
        raise _broken("something follows its end")
    if disk or first_disk or here != count:
        raise _broken("it is spread over several files")
    if count > entry_limit or size > entry_limit * (CENTRAL.size + 2 * NAME_LIMIT_BYTES):
        raise UnfitError(
            f"the archive lists {count} entries in {size} bytes; at most {entry_limit} entries are taken",
            part="the directory",
            slug="archive-too-large",
        )
    if start + size != at:
        _check_zip64(content, (count, size, start), at)
    return count, start, start + size


def _check_zip64(content: memoryview, said: tuple[int, int, int], at: int) -> None:
    """Torch writes the end of an archive in the form for large ones as well; it must say the same."""
    if at - (said[1] + said[2]) != END64.size + LOCATOR64.size:
        raise _broken("there are bytes between its directory and its end, or in front of it")
    mark, size, _, _, disk, first_disk, here, *again = END64.unpack_from(content, at - LOCATOR64.size - END64.size)
    locator, at_disk, record_at, disks = LOCATOR64.unpack_from(content, at - LOCATOR64.size)
    right = (b"PK\x06\x06", END64.size - 12, 0, 0, said[0], b"PK\x06\x07", 0, said[1] + said[2], 1)
    if (mark, size, disk, first_disk, here, locator, at_disk, record_at, disks) != right or tuple(again) != said:
        raise _broken("its two ends contradict each other")


def _central(content: memoryview, at: int, end: int) -> tuple[Entry, int, int]:
    """An entry of the directory without its place, where its own header is, and where the next entry of the directory is."""
    if at + CENTRAL.size > end:
        raise _broken("its directory is shorter than its entries")
    fields = CENTRAL.unpack_from(content, at)
    mark, _, _, flags, method, _, _, crc, packed, plain, name_bytes, extra, comment, disk, _, attributes, header_at = fields
    following = at + CENTRAL.size + name_bytes + extra + comment
    if mark != b"PK\x01\x02" or disk or following > end:
        raise _broken("its directory cannot be read")
    raw = bytes(content[at + CENTRAL.size : at + CENTRAL.size + name_bytes])
    name = _name(raw)
    if flags & ENCRYPTED_FLAGS:
        raise UnfitError("it is encrypted", part=f"entry {name}", slug="archive-encrypted", instead="pack it without a password")
    if method not in (STORED, DEFLATED):
        raise _broken(f"it is packed by method {method}; only stored and deflated entries are taken", name)
    if FULL in (packed, plain, header_at):
        raise _broken("its size is given in the form for huge files", name)
    if method == STORED and packed != plain:
        raise _broken(f"it is stored, but has {packed} bytes here and {plain} there", name)
    kind = stat.S_IFMT(attributes >> 16)
    if kind not in (0, stat.S_IFREG) or attributes & 0x10 or name.endswith("/"):
        what = "a link" if kind == stat.S_IFLNK else "not a plain file"
        raise UnfitError(f"it is {what}; only plain files are taken", part=f"entry {name}", slug="archive-path")
    return Entry(name, method, 0, packed, plain, crc), header_at, following


def _name(raw: bytes) -> str:
    if not 1 <= len(raw) <= NAME_LIMIT_BYTES:
        raise UnfitError(f"an entry's name has {len(raw)} bytes; 1 to {NAME_LIMIT_BYTES} are taken", slug="archive-path")
    try:
        name = raw.decode("ascii")
    except UnicodeDecodeError as error:
        raise UnfitError("an entry's name is not ASCII", slug="archive-path") from error
    parts = name.rstrip("/").split("/")
    if not name.isprintable() or "\\" in name or ":" in name or any(part in ("", ".", "..") for part in parts):
        raise UnfitError(
            "the name leads out of the archive or is no plain path; names like data/0 are taken",
            part=f"entry {name!r}",
            slug="archive-path",
        )
    return name


def _check_names(entries: Sequence[Entry]) -> None:
    seen: set[str] = set()
    for entry in entries:
        if entry.name.lower() in seen:
            raise _broken("there are two entries of this name", entry.name)
        seen.add(entry.name.lower())


def _check_sizes(entries: Sequence[Entry], plain_limit_bytes: int) -> None:
    for entry in entries:
        if entry.plain_bytes > max(FREE_BYTES, RATIO_LIMIT * entry.packed_bytes):
            raise UnfitError(
                f"its {entry.packed_bytes} bytes would become {entry.plain_bytes}; at most {RATIO_LIMIT} times as many are taken",
                part=f"entry {entry.name}",
                slug="archive-too-large",
            )
    total = sum(entry.plain_bytes for entry in entries)
    if total > plain_limit_bytes:
        raise UnfitError(f"the entries have {total} bytes; at most {plain_limit_bytes} are taken", slug="archive-too-large")


def _with_begin(content: memoryview, spans: Sequence[tuple[int, Entry]], directory_at: int) -> list[Entry]:
    """The entries with their place, each checked against its own header and for lying behind the one before."""
    placed, at = [], 0
    for header_at, entry in spans:
        if header_at < at or header_at - at > DESCRIPTOR_LIMIT_BYTES or (at == 0 and header_at != 0):
            raise _broken("it overlaps another entry, or bytes that belong to none lie before it", entry.name)
        if header_at + LOCAL.size > directory_at:
            raise _broken("it lies behind the directory", entry.name)
        mark, _, flags, method, _, _, crc, packed, plain, name_bytes, extra = LOCAL.unpack_from(content, header_at)
        begin = header_at + LOCAL.size + name_bytes + extra
        at = begin + entry.packed_bytes
        name = bytes(content[header_at + LOCAL.size : header_at + LOCAL.size + name_bytes])
        later = bool(flags & DESCRIPTOR_FLAG)
        right = mark == b"PK\x03\x04" and name == entry.name.encode() and method == entry.method and at <= directory_at
        if not right or flags & ENCRYPTED_FLAGS:
            raise _broken("its own header contradicts the directory", entry.name)
        for here, there in ((crc, entry.crc), (packed, entry.packed_bytes), (plain, entry.plain_bytes)):
            if here != there and not (later and here == 0) and not (here == FULL and there != entry.crc):
                raise _broken("its own header contradicts the directory", entry.name)
        placed.append(Entry(entry.name, entry.method, begin, entry.packed_bytes, entry.plain_bytes, entry.crc))
    if directory_at - at > DESCRIPTOR_LIMIT_BYTES:
        raise _broken("bytes that belong to no entry lie before its directory")
    return placed


def _broken(reason: str, name: str | None = None) -> UnfitError:
    return UnfitError(
        f"not a plain zip archive: {reason}",
        part="" if name is None else f"entry {name}",
        slug="archive-malformed",
        instead="send what model.save() wrote, and check that the upload was not cut short",
    )
