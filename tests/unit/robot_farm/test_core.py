"""Turns on a core: one after the other, never waited for without end."""

import os
import time
from multiprocessing import get_context

import pytest

from robot_farm import core


def _hold(folder, number, hold_s, began) -> None:
    with core.turn(folder, number, stop_reason=lambda: None):
        began.put((os.getpid(), time.monotonic()))
        time.sleep(hold_s)


def test_two_processes_take_turns(tmp_path):
    context = get_context("spawn")
    began = context.Queue()
    both = [context.Process(target=_hold, args=(tmp_path, 0, 0.5, began)) for _ in range(2)]
    for process in both:
        process.start()
    first, second = began.get(timeout=120), began.get(timeout=120)
    for process in both:
        process.join(timeout=120)
    began.close()
    began.join_thread()
    assert second[1] - first[1] >= 0.5


@pytest.fixture
def taken(tmp_path):
    context = get_context("spawn")
    began = context.Queue()
    holder = context.Process(target=_hold, args=(tmp_path, 0, 600, began))
    holder.start()
    began.get(timeout=120)
    yield holder
    holder.kill()
    holder.join()
    began.close()
    began.join_thread()


def test_a_robot_that_must_stop_does_not_wait(taken, tmp_path, monkeypatch):
    monkeypatch.setattr(core, "TURN_WITHIN_S", 600.0)
    with core.turn(tmp_path, 0, stop_reason=lambda: "the robot is being stopped"):
        assert taken.is_alive(), "and has the turn"


def test_a_holder_that_hangs_does_not_stop_others(taken, tmp_path, monkeypatch):
    monkeypatch.setattr(core, "TURN_WITHIN_S", 0.3)
    started_s = time.monotonic()
    with core.turn(tmp_path, 0, stop_reason=lambda: None):
        assert time.monotonic() - started_s >= 0.3
        assert taken.is_alive(), "and has the turn"


def test_a_killed_holder_gives_its_turn_back(taken, tmp_path, monkeypatch):
    taken.kill()
    taken.join()
    monkeypatch.setattr(core, "TURN_WITHIN_S", 600.0)
    with core.turn(tmp_path, 0, stop_reason=lambda: None):
        pass


def test_the_core_follows_the_robots_number():
    cores = sorted(os.sched_getaffinity(0))
    try:
        assert core.stay_on_one_core(f"robot-{len(cores) + 1}") == cores[1 % len(cores)]
        assert os.sched_getaffinity(0) == {cores[1 % len(cores)]}
    finally:
        os.sched_setaffinity(0, cores)
