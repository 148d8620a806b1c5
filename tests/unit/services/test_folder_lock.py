"""A folder is held by one process, or by several where they share a database; whoever ended holds nothing."""

import threading

import pytest

from services import folder_lock
from services.errors import NotReady
from services.folder_lock import LOCK, held, is_held
from services.router import END_WITHIN_S


def test_a_folder_is_held_until_the_last_has_left_it(tmp_path):
    path = tmp_path / LOCK
    assert not is_held(path)
    with held(tmp_path, alone=False):
        assert is_held(path)
        with held(tmp_path, alone=False):
            assert is_held(path)
        assert is_held(path)
    assert not is_held(path)


@pytest.mark.parametrize(("first", "second"), [(True, True), (True, False), (False, True)])
def test_a_folder_that_one_has_alone_is_refused_to_others_until_it_ends(first, second, tmp_path, monkeypatch):
    monkeypatch.setattr(folder_lock, "PATIENCE_S", 0.1)
    with held(tmp_path, alone=first):
        with (
            pytest.raises(NotReady, match=f"another process serves the farm in {tmp_path}; stop it first"),
            held(tmp_path, alone=second),
        ):
            pass
        assert is_held(tmp_path / LOCK)
    with held(tmp_path, alone=second):
        assert is_held(tmp_path / LOCK)


def test_an_orderly_end_takes_no_longer_than_it_is_waited_for():
    assert folder_lock.PATIENCE_S > END_WITHIN_S


def test_whoever_is_ending_is_waited_for(tmp_path):
    with held(tmp_path, alone=True):
        pass
    with (tmp_path / LOCK).open() as lock:
        folder_lock._locked(lock.fileno(), folder_lock.fcntl.LOCK_SH)
        leaves = threading.Timer(0.2, lock.close)
        leaves.start()
        with held(tmp_path, alone=True):
            assert is_held(tmp_path / LOCK)
        leaves.join()
