"""Writes MCAP files in blocks: what came since the last flush becomes one chunk, and rows of arrays become messages at once.

The library's own writers take one message a call, which costs a trial with 2,200 messages a second half as much as its physics.
Here only the messages, their index and the chunk around them are laid out with NumPy; all other records are the library's. The
format is that of https://mcap.dev/spec.
"""

import functools
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np
import zstandard
from mcap import records as r
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
COMPRESSION, LEVEL = "zstd", -1
HEADER_BYTES = 31
"""Of a message: opcode, length (8), channel (2), sequence (4), log time (8), publish time (8)."""
_MESSAGE = struct.Struct("<BQHIQQ")
_CHUNK = struct.Struct("<BQQQQII4sQ")
_INDEX = struct.Struct("<BQHI")


@functools.cache
def _library() -> str:
    """Who writes the file; an installed version is read from a file, which takes as long as dozens of steps of a trial."""
    return f"trifarm/{version('trifarm')} mcap-python/{version('mcap')}"


class Schema(Protocol):
    """What messages of a channel are like."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def encoding(self) -> str:
        """Of the data, such as "protobuf" or "jsonschema"."""
        ...

    @property
    def data(self) -> bytes:
        """The description itself."""
        ...


@dataclass(frozen=True)
class Topic:
    """A channel: how its messages are encoded, and their schema."""

    message_encoding: str
    schema: Schema


@dataclass
class _Channel:
    """A channel that has messages: its id, how many they are, and where those of this chunk are, as (log time, offset)."""

    id: int
    count: int = 0
    here: list[np.ndarray] = field(default_factory=list)


def room_for(rows: int, size: int) -> np.ndarray:
    """Room for messages of one size with their headers, shape (rows, HEADER_BYTES + size), for :meth:`BlockWriter.rows`."""
    return np.empty((rows, HEADER_BYTES + size), np.uint8)


def column(rows: np.ndarray, place: int, dtype: str) -> np.ndarray:
    """One number of each row, at a place in bytes, as an array to be written."""
    return np.ndarray((len(rows),), dtype, rows, place, (rows.strides[0],)) if len(rows) else np.empty(0, dtype)


class BlockWriter:
    """One file; a context manager.

    Args:
        path: file to create; it must not exist.
        topics: the channels that there may be; one without messages is not in the file.
    """

    def __init__(self, path: Path, topics: Mapping[str, Topic]) -> None:
        self._file = path.open("xb", buffering=0)
        self._topics = topics
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[tuple[str, bytes], r.Schema] = {}
        self._records: list[r.Channel] = []
        self._compressor = zstandard.ZstdCompressor(level=LEVEL, write_checksum=False)
        self._parts: list[bytes | memoryview] = []
        self._size, self._times = 0, [2**63, 0]
        self._offset, self._message_times = 0, [2**63, 0]
        self._chunks: list[r.ChunkIndex] = []
        self._attachments: list[r.AttachmentIndex] = []
        self._metadata: list[r.MetadataIndex] = []
        self._write(MAGIC + _built(r.Header(profile="", library=_library())))

    def __enter__(self) -> "BlockWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def message(self, topic: str, data: bytes, time_ns: int) -> None:
        """One message."""
        channel = self._channel(topic)
        header = _MESSAGE.pack(Opcode.MESSAGE, HEADER_BYTES - 9 + len(data), channel.id, channel.count, time_ns, time_ns)
        channel.here.append(np.array([[time_ns, self._size]], np.uint64))
        channel.count += 1
        self._seen(time_ns, time_ns)
        self._add(header + data)

    def rows(self, topic: str, rows: np.ndarray, times_ns: np.ndarray) -> None:
        """Many messages of one size.

        Args:
            topic: of all of them.
            rows: from :func:`room_for`, filled but for the headers; it is not to be used afterwards.
            times_ns: shape (n,), int64, in their order.
        """
        count, width = rows.shape
        if not count:
            return
        channel = self._channel(topic)
        rows[:, :HEADER_BYTES] = np.frombuffer(
            _MESSAGE.pack(Opcode.MESSAGE, width - 9, channel.id, channel.count, 0, 0), np.uint8
        )
        column(rows, 11, "<u4")[:] = np.arange(channel.count, channel.count + count)
        np.ndarray((count, 2), "<u8", rows, 15, (width, 8))[:] = times_ns[:, None]
        index = np.empty((count, 2), np.uint64)
        index[:, 0], index[:, 1] = times_ns, np.arange(self._size, self._size + rows.size, width)
        channel.here.append(index)
        channel.count += count
        self._seen(int(times_ns[0]), int(times_ns[-1]))
        self._add(rows.data)

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """A metadata record."""
        built = _built(r.Metadata(name=name, metadata=values))
        self._metadata.append(r.MetadataIndex(offset=self._offset, length=len(built), name=name))
        self._write(built)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """A file inside the file."""
        built = _built(r.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data))
        about = {"create_time": 0, "log_time": 0, "name": name, "media_type": media_type, "data_size": len(data)}
        self._attachments.append(r.AttachmentIndex(offset=self._offset, length=len(built), **about))
        self._write(built)

    def flush(self) -> None:
        """Hand what came since the last flush to the operating system, as one chunk."""
        if not self._parts:
            return
        plain = b"".join(self._parts)
        packed = self._compressor.compress(plain)
        begins, ends = self._times if self._times[1] >= self._times[0] else (0, 0)
        length = _CHUNK.size + len(packed)
        about = (begins, ends, len(plain), zlib.crc32(plain), len(COMPRESSION), COMPRESSION.encode(), len(packed))
        indexes, places = [], {}
        at = self._offset + length
        for channel in self._channels.values():
            if channel.here:
                pairs = np.concatenate(channel.here).tobytes()
                places[channel.id] = at
                indexes.append(_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs), channel.id, len(pairs)) + pairs)
                at += len(indexes[-1])
                channel.here = []
        self._chunks.append(
            r.ChunkIndex(
                chunk_length=length,
                chunk_start_offset=self._offset,
                compression=COMPRESSION,
                compressed_size=len(packed),
                message_end_time=ends,
                message_index_length=at - self._offset - length,
                message_index_offsets=places,
                message_start_time=begins,
                uncompressed_size=len(plain),
            )
        )
        self._parts, self._size, self._times = [], 0, [2**63, 0]
        self._write(b"".join([_CHUNK.pack(Opcode.CHUNK, length - 9, *about), packed, *indexes]))

    def close(self) -> None:
        """Write the rest, and the summary without which a reader knows that the writer did not finish."""
        if self._file.closed:
            return
        try:
            self.flush()
            self._write(_built(r.DataEnd(data_section_crc=0)))
            self._write(self._summary())
        finally:
            self._file.close()

    def _summary(self) -> bytes:
        begins, ends = self._message_times if self._message_times[1] >= self._message_times[0] else (0, 0)
        statistics = r.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._records),
            channel_message_counts={channel.id: channel.count for channel in self._channels.values()},
            chunk_count=len(self._chunks),
            message_count=sum(channel.count for channel in self._channels.values()),
            message_end_time=ends,
            message_start_time=begins,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups = (
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, self._records),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        summary, offsets = b"", b""
        for opcode, members in groups:
            if members:
                built = b"".join(_built(each) for each in members)
                place = {"group_start": self._offset + len(summary), "group_length": len(built)}
                offsets += _built(r.SummaryOffset(group_opcode=opcode, **place))
                summary += built
        starts = self._offset, self._offset + len(summary)
        whole = summary + offsets
        footer = _built(r.Footer(summary_start=starts[0], summary_offset_start=starts[1], summary_crc=0))[:-4]
        return whole + footer + struct.pack("<I", zlib.crc32(whole + footer)) + MAGIC

    def _channel(self, topic: str) -> _Channel:
        """The topic's channel, which is written into the chunk of its first message, after its schema."""
        if (known := self._channels.get(topic)) is not None:
            return known
        about = self._topics[topic]
        schema = self._schemas.get((about.schema.name, about.schema.data))
        if schema is None:
            number, given = len(self._schemas) + 1, about.schema
            schema = r.Schema(id=number, data=given.data, encoding=given.encoding, name=given.name)
            self._schemas[given.name, given.data] = schema
            self._add(_built(schema))
        record = r.Channel(
            id=len(self._records) + 1,
            topic=topic,
            message_encoding=about.message_encoding,
            metadata={},
            schema_id=schema.id,
        )
        self._records.append(record)
        self._add(_built(record))
        made = self._channels[topic] = _Channel(record.id)
        return made

    def _seen(self, first_ns: int, last_ns: int) -> None:
        for times in (self._times, self._message_times):
            times[0], times[1] = min(times[0], first_ns), max(times[1], last_ns)

    def _add(self, part: bytes | memoryview) -> None:
        self._parts.append(part)
        self._size += memoryview(part).nbytes

    def _write(self, data: bytes) -> None:
        """All of it: the file has no buffer, and may take less than was given."""
        self._offset += len(data)
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]


def _built(record: r.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
