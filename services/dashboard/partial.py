"""Which parts of a large log are read: its summary, its metadata, and chunks evenly over its time, as far as a budget reaches."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

WHOLE_BYTES = 32 * 1024**2
"""Logs up to so large are read whole; a trial of 30 s has a third of it."""
MOST_PACKED_BYTES = 32 * 1024**2
MOST_UNPACKED_BYTES = 96 * 1024**2
"""Of the chunks that are read of a larger one: what one core unpacks and looks through in a few seconds."""
HEAD = struct.Struct("<BQ")
"""Of a record: opcode and length (https://mcap.dev/spec)."""
MESSAGE = struct.Struct("<HIQQ")
"""Of a message: channel, sequence, time of its log and of its publication in ns; its data follow."""

Span = tuple[int, int]


def chosen(summary: Summary, size: int) -> list[ChunkIndex]:
    """The chunks to read of a log of ``size`` bytes, by time: all, or as many as the budget allows, evenly spread."""
    chunks = sorted(summary.chunk_indexes, key=lambda each: (each.message_start_time, each.chunk_start_offset))
    if size <= WHOLE_BYTES:
        return chunks
    packed, unpacked = (sum(getattr(each, name) for each in chunks) for name in ("chunk_length", "uncompressed_size"))
    share = min(1.0, MOST_PACKED_BYTES / max(1, packed), MOST_UNPACKED_BYTES / max(1, unpacked))
    count = max(2, int(share * len(chunks)))
    if count >= len(chunks):
        return chunks
    picked = sorted({round(place * (len(chunks) - 1) / (count - 1)) for place in range(count)})
    return _within_budget([chunks[at] for at in picked])


def _within_budget(chunks: list[ChunkIndex]) -> list[ChunkIndex]:
    """Chunks of one log may be of very different size: those that would break the budget are left out."""
    kept, packed, unpacked = [], 0, 0
    for each in chunks:
        packed, unpacked = packed + each.chunk_length, unpacked + each.uncompressed_size
        if packed > MOST_PACKED_BYTES or unpacked > MOST_UNPACKED_BYTES:
            break
        kept.append(each)
    return kept


def plan(summary: Summary, size: int) -> list[Span]:
    """The byte ranges that a reader of the chosen parts needs besides the log's beginning and its summary."""
    chunks = [(each.chunk_start_offset, each.chunk_start_offset + each.chunk_length) for each in chosen(summary, size)]
    records = [(each.offset, each.offset + each.length) for each in summary.metadata_indexes]
    return sorted(chunks + records)


@dataclass(frozen=True)
class Found:
    """A message as the file has it; ``log_time`` in ns."""

    schema: Schema | None
    channel: Channel
    log_time: int
    data: bytes


def messages(stream: BinaryIO, summary: Summary, chunks: list[ChunkIndex], every: Mapping[str, int]) -> Iterator[Found]:
    """The messages of some chunks, of some topics, in the order of the file; of a topic the first of each so many.

    Most messages of a log are left out, and to read each as a record of the MCAP library takes three times as long as the rest:
    here only the two heads of a record are read before it is known to be wanted.
    """
    wanted = {number: channel for number, channel in summary.channels.items() if channel.topic in every}
    left = dict.fromkeys(every, 0)
    for each in chunks:
        stream.seek(each.chunk_start_offset + HEAD.size)
        unpacked, size = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)))
        content, at = unpacked.read(size), 0
        while at < size:
            opcode, length = HEAD.unpack_from(content, at)
            begin, at = at + HEAD.size, at + HEAD.size + length
            if opcode != Opcode.MESSAGE:
                continue
            number, _, log_time, _ = MESSAGE.unpack_from(content, begin)
            if (channel := wanted.get(number)) is None:
                continue
            if left[channel.topic] == 0:
                left[channel.topic] = every[channel.topic]
                yield Found(summary.schemas.get(channel.schema_id), channel, log_time, content[begin + MESSAGE.size : at])
            left[channel.topic] -= 1
