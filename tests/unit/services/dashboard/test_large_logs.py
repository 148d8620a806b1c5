"""A log of 300 MB: of it only a part is read, by the farm for its page and by a viewer that asks for ranges."""

import io
import json

import httpx
import numpy as np
import pytest
from fastapi import FastAPI, Request
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from services.api.serving import stored_file
from services.dashboard import bringing, reduction, replays
from services.dashboard.bringing import UnreadableError, bring, spans
from services.dashboard.partial import MOST_PACKED_BYTES, MOST_UNPACKED_BYTES
from trial_logs import trial_log as t

SIZE = 300 * 1000**2
CHUNK_BYTES = 1024 * 1024
FILLER = b"\x5a" * (250 * 1000)
"""Chunks are stored unpacked, so that it takes as long to make as to write."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A trial of 120 s whose tracker reports stand between 300 MB of something else."""
    path = tmp_path_factory.mktemp("large") / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        tracker, other = (writer.register_channel(topic, "json", schema) for topic in (t.TRACKER, "/measured/other"))
        for number in range(SIZE // len(FILLER)):
            at_ns = number * 100_000_000
            writer.add_message(other, at_ns, FILLER, at_ns)
            writer.add_message(tracker, at_ns, json.dumps({"confidence": 0.5, "capture_time_s": at_ns / 1e9}).encode(), at_ns)
        writer.add_metadata("trial", {"task": "lift"})
        writer.finish()
    return path


class Counting:
    """A store that counts what is read of it."""

    def __init__(self, path):
        self.path, self.bytes = path, 0

    async def size(self, _sha256):
        return self.path.stat().st_size

    async def read(self, _sha256, start=0, end=None):
        with self.path.open("rb") as file:
            file.seek(start)
            part = file.read((end or self.path.stat().st_size) - start)
        self.bytes += len(part)
        yield part


async def test_only_a_part_is_read_for_the_page(log, tmp_path):
    store, size = Counting(log), log.stat().st_size
    assert size > 299 * 1000**2
    brought = tmp_path / "log.mcap"
    read = await bring(store, "0" * 64, size, brought, replays.plan_in)
    assert read <= store.bytes < 1.05 * MOST_PACKED_BYTES < size / 8
    assert brought.stat().st_size == size and brought.stat().st_blocks * 512 < 1.1 * store.bytes, "the rest are holes"
    made = await replays.reduce_in(tmp_path, "log.mcap")
    header = json.loads(made[4 : 4 + int.from_bytes(made[:4], "little")])
    shown, chunks = header["parts"]
    assert 0.05 * chunks < shown < 0.2 * chunks and header["task"] == "lift"
    assert len(made) < 1024**2
    assert header["duration_s"] > 110, "from its beginning to its end"


def test_what_is_read_lies_evenly_over_the_time(log):
    with log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        chosen = reduction.partial.chosen(summary, log.stat().st_size)
    starts_s = np.array([each.message_start_time for each in chosen]) / 1e9
    assert np.diff(starts_s).max() < 3 * np.median(np.diff(starts_s))
    assert sum(each.uncompressed_size for each in chosen) <= MOST_UNPACKED_BYTES


async def test_a_viewer_that_asks_for_ranges_gets_no_more(log):
    store, app = Counting(log), FastAPI()

    @app.get("/log")
    async def get(request: Request):
        return await stored_file(request, store, "0" * 64, "application/vnd.mcap", "log.mcap")

    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://farm") as client:

        async def part(start, end):
            answer = await client.get("/log", headers={"Range": f"bytes={start}-{end - 1}"})
            assert answer.status_code == 206
            return answer.content

        size = int((await client.get("/log", headers={"Range": "bytes=0-7"})).headers["content-range"].rpartition("/")[2])
        tail = await part(size - 1024**2, size)
        sparse = io.BytesIO()
        sparse.write(await part(0, 4096))
        sparse.seek(size - 1024**2)
        sparse.write(tail)
        sparse.seek(0)
        summary = make_reader(sparse).get_summary()
        chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
        sparse.seek(chunk.chunk_start_offset)
        sparse.write(await part(chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length))
        found = list(reduction.partial.messages(sparse, summary, [chunk], {t.TRACKER: 1}))
    assert found and store.bytes < 4 * CHUNK_BYTES


async def test_a_small_log_comes_whole(short_log, tmp_path):
    store = Counting(short_log)
    size = short_log.stat().st_size
    assert await bring(store, "0" * 64, size, tmp_path / "log.mcap", replays.plan_in) == size
    assert (tmp_path / "log.mcap").read_bytes() == short_log.read_bytes()


@pytest.mark.parametrize("told", [b"", b"{}", b"[[0]]", b'[["a", 1]]', b"[[5, 1]]", b"[[-1, 5]]", b"[[0, 101]]", b"[[NaN, 1]]"])
def test_a_won_over_process_asks_for_nothing_else(told):
    if told == b"{}":
        assert spans(told, 100) == []
        return
    with pytest.raises(UnreadableError):
        spans(told, 100)


def test_nor_for_more_than_is_read_of_a_log():
    size = 10 * MOST_PACKED_BYTES
    with pytest.raises(UnreadableError, match="are not read"):
        spans(json.dumps([[0, size]]).encode(), size)
    with pytest.raises(UnreadableError, match="are not read"):
        spans(json.dumps([[0, 1]] * (bringing.MOST_SPANS + 1)).encode(), size)


async def test_a_large_file_without_a_summary_is_no_log(tmp_path, monkeypatch):
    monkeypatch.setattr(bringing, "WHOLE_BYTES", 100)
    path = tmp_path / "none"
    path.write_bytes(bytes(5000))
    with pytest.raises(UnreadableError, match="no summary"):
        await bring(Counting(path), "0" * 64, 5000, tmp_path / "log.mcap", replays.plan_in)
