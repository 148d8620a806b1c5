import hashlib

import pytest

from services.errors import Refused, TooLarge
from services.files.store import FileStore


async def chunks(*parts):
    for part in parts:
        yield part


async def whole(store, sha256, *span):
    return b"".join([chunk async for chunk in store.read(sha256, *span)])


@pytest.fixture
def store(tmp_path):
    return FileStore(tmp_path)


def sha(content):
    return hashlib.sha256(content).hexdigest()


async def test_content_comes_back_under_its_hash(store):
    stored = await store.put(chunks(b"hello ", b"", b"world"), limit_bytes=11, durable=True)
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


async def test_a_missing_object(store):
    assert await store.size("0" * 64) is None
    with pytest.raises(FileNotFoundError):
        await whole(store, "0" * 64)
