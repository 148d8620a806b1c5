import asyncio
import hashlib
import os
import subprocess
import sys
import threading
import time
from datetime import timedelta

import pytest

from services.errors import NotReady, Refused, TooLarge, Unavailable
from services.files import homes
from services.files.homes import open_home
from services.files.store import FileStore
from services.settings import Settings
from tests.homes import S3_KEYS, free_port, s3_home_settings
from tests.integration.farm_process import ROOT


async def chunks(*parts):
    for part in parts:
        yield part


async def whole(store, sha256, *span):
    return b"".join([chunk async for chunk in store.read(sha256, *span)])


@pytest.fixture(params=["local", "s3"])
def store(request, tmp_path):
    """A store on each home; what comes in is gathered below ``tmp_path``."""
    if request.param == "local":
        return FileStore(tmp_path)
    return FileStore(tmp_path, open_home(s3_home_settings(request.getfixturevalue("s3"))))


def sha(content):
    return hashlib.sha256(content).hexdigest()


async def test_content_comes_back_under_its_hash(store):
    stored = await store.put(chunks(b"hello ", b"", b"world"), limit_bytes=11)
    assert (stored.sha256, stored.size, stored.new) == (sha(b"hello world"), 11, True)
    assert await whole(store, stored.sha256) == b"hello world"
    assert await whole(store, stored.sha256, 6, 9) == b"wor"
    assert await whole(store, stored.sha256, 5, 5) == b""
    assert await store.size(stored.sha256) == 11


async def test_the_same_content_again_is_not_new(store, tmp_path):
    first, second = [await store.put(chunks(b"same"), limit_bytes=9) for _ in range(2)]
    assert (first.new, second.new) == (True, False)
    assert list((tmp_path / "incoming").iterdir()) == []


async def test_large_content_and_empty_content(store):
    large = b"0123456789" * 300_000
    stored = await store.put(chunks(large[:5], large[5:2_000_000], large[2_000_000:]), limit_bytes=len(large))
    assert await whole(store, stored.sha256) == large
    empty = await store.put(chunks(), limit_bytes=0)
    assert await whole(store, empty.sha256) == b""


async def test_other_content_than_announced_leaves_nothing(store, tmp_path):
    with pytest.raises(Refused, match="as announced"):
        await store.put(chunks(b"a"), limit_bytes=9, expected_sha256="0" * 64)
    assert await store.size(sha(b"a")) is None
    assert list((tmp_path / "incoming").iterdir()) == []


async def test_too_much_is_refused_while_it_comes(store, tmp_path):
    with pytest.raises(TooLarge, match="10 bytes"):
        await store.put(chunks(b"x" * 6, b"x" * 6), limit_bytes=10)
    assert list((tmp_path / "incoming").iterdir()) == []


async def test_a_sender_that_breaks_off_leaves_nothing(store, tmp_path):
    async def broken():
        yield b"half"
        raise ConnectionError("gone")

    with pytest.raises(ConnectionError):
        await store.put(broken(), limit_bytes=10)
    assert list((tmp_path / "incoming").iterdir()) == []


async def test_what_a_killed_process_left_is_forgotten(store, tmp_path):
    (tmp_path / "incoming" / "half").write_bytes(b"x")
    assert store.forget_unfinished() == 1
    assert store.forget_unfinished() == 0


@pytest.mark.parametrize("left", [b"", b"con", b"COntent"])
async def test_what_a_power_cut_left_of_a_file_is_replaced_when_it_comes_again(tmp_path, left):
    store = FileStore(tmp_path)
    stored = await store.put(chunks(b"content"), limit_bytes=9)
    place = tmp_path / "sha256" / stored.sha256[:2] / stored.sha256
    place.write_bytes(left)
    assert (await store.put(chunks(b"content"), limit_bytes=9)).new
    assert place.read_bytes() == b"content"
    assert not (await store.put(chunks(b"content"), limit_bytes=9)).new


async def test_the_disk_has_a_file_and_its_name_before_it_is_acknowledged_and_the_loop_does_not_wait_for_it(
    tmp_path, monkeypatch
):
    store, synced, sync = FileStore(tmp_path), [], os.fsync

    def noted(opened):
        assert threading.current_thread() is not threading.main_thread()
        synced.append(os.fstat(opened).st_ino)
        sync(opened)

    monkeypatch.setattr(os, "fsync", noted)
    sha256 = (await store.put(chunks(b"content"), limit_bytes=9)).sha256
    folder = tmp_path / "sha256" / sha256[:2]
    assert synced == [path.stat().st_ino for path in (folder / sha256, folder, folder.parent, tmp_path)]
    synced.clear()
    await store.put(chunks(b"content"), limit_bytes=9)
    assert folder.stat().st_ino in synced  # whoever put it first may not have come so far yet


@pytest.mark.parametrize("in_one_piece", [True, False])
async def test_what_comes_again_is_young_again(store, monkeypatch, in_one_piece):
    if not in_one_piece:
        monkeypatch.setattr(homes, "IN_ONE_PIECE_BYTES", 0)
    first = await store.put(chunks(b"content"), limit_bytes=9)
    before = await store.find(first.sha256)
    await asyncio.sleep(1.1)  # S3 counts seconds
    assert not (await store.put(chunks(b"content"), limit_bytes=9)).new
    now = await store.find(first.sha256)
    assert (now.sha256, now.size) == (before.sha256, before.size)
    assert now.stored_s > before.stored_s


async def test_a_missing_object(store):
    assert await store.size("0" * 64) is None
    with pytest.raises(FileNotFoundError):
        await whole(store, "0" * 64)


async def test_a_file_in_parts_is_the_same_file(store, monkeypatch):
    monkeypatch.setattr(homes, "IN_ONE_PIECE_BYTES", 1_000_000)
    monkeypatch.setattr(homes, "PART_BYTES", 6_000_000)
    large = b"0123456789" * 1_300_000
    first, second = [await store.put(chunks(large), limit_bytes=len(large)) for _ in range(2)]
    assert (first.new, second.new) == (True, False)
    assert await store.size(sha(large)) == len(large)
    assert await whole(store, sha(large)) == large


async def test_what_is_listed_can_be_removed(store):
    kept = {(await store.put(chunks(content), limit_bytes=9)).sha256: len(content) for content in (b"", b"one", b"three")}
    listed = [each async for each in store.all()]
    assert {each.sha256: each.size for each in listed} == kept
    assert all(abs(each.stored_s - time.time()) < 60 for each in listed)
    await store.remove(sha(b"one"))
    await store.remove(sha(b"one"))
    assert await store.size(sha(b"one")) is None
    assert {each.sha256 async for each in store.all()} == set(kept) - {sha(b"one")}


async def test_several_who_put_the_same_at_once_make_one(store):
    stored = await asyncio.gather(*(store.put(chunks(b"same"), limit_bytes=9) for _ in range(8)))
    assert sum(each.new for each in stored) == 1


async def test_a_server_that_does_not_answer_is_an_error_that_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(homes, "TRIES", {"max_retries": 0, "retry_timeout": timedelta(seconds=1)})
    nobody = Settings(files_url="s3://bucket", s3_endpoint=f"http://127.0.0.1:{free_port()}", **S3_KEYS)
    store = FileStore(tmp_path, open_home(nobody))
    with pytest.raises(Unavailable, match="did not answer"):
        await store.put(chunks(b"x"), limit_bytes=9)
    with pytest.raises(Unavailable):
        await store.size(sha(b"x"))


def test_another_home_than_these_is_refused():
    with pytest.raises(NotReady, match=r"gs://b; give s3://bucket/prefix"):
        open_home(Settings(files_url="gs://b"))


FULL_DISK = """
import asyncio, os, subprocess, sys
from pathlib import Path
from services.errors import Unavailable
from services.files.store import FileStore

async def chunks(size):
    yield bytes(size)

async def main(folder):
    store = FileStore(folder)
    ballast = folder / "ballast"
    ballast.write_bytes(bytes(900_000))
    try:
        await store.put(chunks(500_000), limit_bytes=10**6)
    except Unavailable as error:
        print(error.slug, len(list((folder / "incoming").iterdir())))
    ballast.unlink()
    print((await store.put(chunks(500_000), limit_bytes=10**6)).new)

subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", sys.argv[1]], check=True)
asyncio.run(main(Path(sys.argv[1])))
"""


def test_a_full_disk_is_said_and_leaves_nothing_behind(tmp_path):
    command = ["unshare", "--mount", sys.executable, "-c", FULL_DISK, str(tmp_path)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if "Operation not permitted" in ran.stderr or "must be superuser" in ran.stderr:
        pytest.skip("a small disk of one's own needs root")
    assert ran.stdout.split()[-3:] == ["disk-full", "0", "True"], ran.stderr
