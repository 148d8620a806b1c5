"""The seam: the same results in this process, in processes of this machine and on Ray, also when workers are lost."""

import functools
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from sim_backend.workers import pool
from sim_backend.workers.cluster import connected, is_loopback
from sim_backend.workers.pool import Places, WorkersError, open_workers
from tests.unit.sim_backend.workers.works import BeginsEachThirdTime, Endless, EndsOnce, NeverBegins, Square


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_results_are_in_the_order_of_the_items_whatever_the_number_of_workers(workers):
    assert pool.map(Square, range(7), workers=workers) == [0, 1, 4, 9, 16, 25, 36]


def test_what_is_shared_reaches_all_and_is_sent_anew_when_it_changes():
    with open_workers(Square, 2) as workers:
        assert list(workers.map([1, 2, 3], 10)) == [11, 14, 19]
        before = workers.moved_bytes
        assert list(workers.map([1, 2, 3], 20)) == [21, 24, 29]
        assert workers.moved_bytes > before
        assert list(workers.map([], 20)) == []


@pytest.mark.parametrize("workers", [0, 2])
def test_an_error_of_the_work_is_raised(workers):
    with pytest.raises(ValueError, match="not a number"):
        pool.map(Square, [1, "wrong"], workers=workers)


def test_what_a_lost_worker_had_is_done_again(tmp_path):
    with open_workers(functools.partial(EndsOnce, str(tmp_path)), 2) as workers:
        assert list(workers.map(range(7))) == list(range(7))
        assert sorted(workers.lost) == [0, 3, 6]
        assert list(workers.map(range(7))) == list(range(7))
        assert workers.lost == []


def test_an_item_that_ends_every_worker_is_an_error(tmp_path):
    with pytest.raises(WorkersError, match="item 1 ended 5 workers"):
        pool.map(functools.partial(EndsOnce, str(tmp_path), always=True), [1, 3], workers=1)


def test_workers_that_end_before_they_begin_are_not_the_item_s_fault_but_do_not_go_on_for_ever(tmp_path):
    make = functools.partial(BeginsEachThirdTime, str(tmp_path))
    with pytest.raises(WorkersError, match="item 1 ended 5 workers"), open_workers(make, 1) as workers:
        assert list(workers.map([1, "end"])) == []
    assert len([*tmp_path.iterdir()]) in (15, 16), "each of the five came after two that had not begun, and perhaps one more"
    with pytest.raises(WorkersError, match="5 workers in a row ended before they began"):
        pool.map(NeverBegins, [1], workers=1)


def test_workers_without_an_item_that_end_before_they_begin_do_not_go_on_for_ever_either():
    places = Places([1], 1, [])
    for _ in range(4):
        places.not_begun()
    places.came()
    for _ in range(4):
        places.not_begun()
    with pytest.raises(WorkersError, match="5 workers in a row ended before they began"):
        places.not_begun()


def test_a_worker_does_not_outlive_whoever_gave_it_work(tmp_path):
    at = tmp_path / "pid"
    imports = f"from sim_backend.workers import pool; from {Endless.__module__} import Endless"
    code = f"{imports}; pool.map(Endless, [{str(at)!r}], workers=1)"
    giver = subprocess.Popen([sys.executable, "-c", code])
    try:
        _until(lambda: at.exists() and at.read_text())
        assert _works(int(at.read_text()))
        giver.kill()
        _until(lambda: not _works(int(at.read_text())))
    finally:
        giver.kill()
        giver.wait()
        with suppress(OSError, ValueError):
            os.kill(int(at.read_text()), signal.SIGKILL)


def _until(holds, within_s=60.0):
    end_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def _works(pid):
    """Whether a process is there that has not ended; nobody may have asked how it did."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_other_machines_are_reached_with_a_token_only(monkeypatch):
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    with pytest.raises(WorkersError, match="RAY_AUTH_MODE=token"):
        connected("192.0.2.7:6379")
    own = ["local", "localhost:6379", "127.0.0.1:6379", "[::1]:6379"]
    assert [is_loopback(each) for each in (*own, "192.0.2.7:6379", "farm.example:6379", "auto")] == [True] * 4 + [False] * 3


def test_nothing_loads_ray_before_it_is_asked_for():
    code = "import sys, sim_backend.workers.cluster, sim_backend.workers.processes; print('ray' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "False"
