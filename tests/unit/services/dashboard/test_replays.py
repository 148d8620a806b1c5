"""Replays are made in a jail: a log that anyone may have made takes no more than its share, and the folder stays small."""

import asyncio
import json
import os
import shutil
import struct
import sys

import pytest
import zstandard
from mcap.writer import Writer

from services.dashboard import reduction, replays
from services.errors import Unavailable
from tests.hostile.measured import Cost, run_measured
from trial_logs import trial_log as t

UNFOLDED_BYTES = 700 * 1024**2


@pytest.fixture
def bomb(tmp_path, monkeypatch):
    """A folder with a good log whose only chunk unfolds to 700 MB, most of them zeros; it is as small as any."""

    def pack(chunk):
        packer = zstandard.ZstdCompressor().compressobj(size=len(chunk) + UNFOLDED_BYTES)
        zeros = bytes(1024**2)
        parts = [packer.compress(chunk), *(packer.compress(zeros) for _ in range(UNFOLDED_BYTES // len(zeros)))]
        return b"".join([*parts, packer.flush()])

    folder = tmp_path / "bomb"
    folder.mkdir()
    with (folder / "log.mcap").open("wb") as file, monkeypatch.context() as patched:
        patched.setattr(zstandard, "compress", pack)
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(t.TRACKER, "json", writer.register_schema("s", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b'{"confidence": 1.0}', 1)
        writer.finish()
    assert (folder / "log.mcap").stat().st_size < 100_000
    return folder


async def test_a_log_becomes_the_same_in_the_jail(short_log, tmp_path):
    folder = tmp_path / "jailed"
    folder.mkdir()
    shutil.copy(short_log, folder / "log.mcap")
    reduction.main([str(short_log), str(tmp_path / "free.bin")])
    assert await replays.reduce_in(folder, "log.mcap") == (tmp_path / "free.bin").read_bytes()


async def test_truth_that_a_log_holds_can_be_left_out(short_log, tmp_path):
    header, arrays = reduction.reduce(short_log, None)
    assert len(arrays["true_pose"]) and {"cube"} <= {each["id"] for each in header["entities"]}
    folder = tmp_path / "jail"
    folder.mkdir()
    shutil.copy(short_log, folder / "log.mcap")
    made = await replays.reduce_in(folder, "log.mcap", how=("measured",))
    (length,) = struct.unpack_from("<I", made)
    measured = json.loads(made[4 : 4 + length])
    assert measured["arrays"]["true_pose"]["shape"] == [0, 7] and measured["arrays"]["true_t_s"]["shape"] == [0]
    assert "cube" not in {each["id"] for each in measured["entities"]}
    assert measured["arrays"]["tracked_pose"]["shape"] == list(arrays["tracked_pose"].shape)


async def test_a_log_that_unfolds_without_end_is_refused(bomb):
    with pytest.raises(Unavailable, match="could not be read"):
        await replays.reduce_in(bomb, "log.mcap")


def test_a_log_that_unfolds_without_end_gets_no_more_than_its_memory(bomb):
    cost = Cost()
    command = [sys.executable, "-P", "-m", "services.dashboard.reduction", "log.mcap", "replay.bin"]
    assert run_measured(cost, command, bomb).status != 0
    assert 0 < cost.memory_bytes < UNFOLDED_BYTES


def test_what_is_too_large_or_no_file_is_not_read(short_log, tmp_path, monkeypatch):
    (tmp_path / "link").symlink_to(short_log)
    with pytest.raises(OSError, match="symbolic"):
        replays._read(tmp_path / "link")
    os.mkfifo(tmp_path / "pipe")
    assert replays._read(tmp_path / "pipe") is None
    monkeypatch.setattr(replays, "LARGEST_REPLAY_BYTES", 10)
    (tmp_path / "large").write_bytes(bytes(11))
    (tmp_path / "small").write_bytes(bytes(10))
    assert (replays._read(tmp_path / "large"), replays._read(tmp_path / "small")) == (None, bytes(10))


async def test_readers_take_turns_and_what_is_kept_waits_for_nobody(tmp_path, monkeypatch):
    kept, made, goes_on = replays.Replays(tmp_path), [], asyncio.Event()

    async def make(_farm, path, _sources, *_how):
        made.append(path.name[:3])
        await goes_on.wait()
        path.write_bytes(b"made")

    monkeypatch.setattr(kept, "_make", make)
    asked = [asyncio.create_task(kept.images(None, "ann", f"ann{number}")) for number in range(5)]
    asked.append(asyncio.create_task(kept.images(None, "bob", "bob0")))
    while sum(kept._turns._waiting.values()) < len(asked):  # noqa: ASYNC110  threads look for the files
        await asyncio.sleep(0.01)
    (tmp_path / f"old-images-{replays.FORM}.gz").write_bytes(b"made before")
    await asyncio.wait_for(kept.images(None, "cid", "old"), 5.0)
    goes_on.set()
    await asyncio.gather(*asked)
    assert made in (["ann", "bob", *["ann"] * 4], ["bob", *["ann"] * 5]), "bob waits for one of ann at most"


async def test_a_replay_that_another_process_removed_is_made_again_and_never_empty(tmp_path, monkeypatch):
    kept = replays.Replays(tmp_path)

    async def make(_farm, path, _sources, *_how):
        path.write_bytes(b"made")

    monkeypatch.setattr(kept, "_make", make)
    path = await kept.images(None, "ann", "log")
    path.unlink()
    assert (await kept.images(None, "ann", "log")).read_bytes() == b"made"


def test_the_folder_keeps_what_was_looked_at_last(tmp_path, monkeypatch):
    monkeypatch.setattr(replays, "KEPT_BYTES", 5 * replays.COUNTED_BYTES)
    kept = replays.Replays(tmp_path / "replays")
    for number, size in enumerate((1, 1, 2 * replays.COUNTED_BYTES, 1)):
        path = kept.folder / f"{number}.bin"
        kept.keep(path, bytes(size))
        os.utime(path, (number, number))
    os.utime(kept.folder / "0.bin", (9, 9))
    kept.keep(kept.folder / "4.bin", b"")
    assert sorted(path.name for path in kept.folder.iterdir()) == ["0.bin", "2.bin", "3.bin", "4.bin"]
