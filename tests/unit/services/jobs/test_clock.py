import time

import pytest

from services.jobs import clock as clock_module
from services.jobs.clock import FarmClock, iso


def test_a_jump_of_the_walls_clock_does_not_move_the_farms(monkeypatch):
    clock = FarmClock.start()
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert abs(clock.now_s() - clock.started_s) < 1


@pytest.mark.parametrize("step_s, back", [(-3600.0, True), (-0.5, False), (3600.0, False)])
async def test_a_large_step_back_of_the_databases_clock_is_followed_and_a_small_one_waited_out(monkeypatch, step_s, back):
    clock = FarmClock.start()
    before_s = clock.now_s()

    async def reading(_database):
        return before_s + step_s, time.monotonic(), 0.0

    monkeypatch.setattr(clock_module, "_reading", reading)
    went_back_s = await clock.set_by(None)
    now_s = clock.now_s()
    if back:
        assert went_back_s == pytest.approx(3600.0, abs=5.0) and now_s == pytest.approx(before_s - 3600.0, abs=5.0)
    else:
        assert went_back_s == 0.0 and now_s >= max(before_s, before_s + step_s)
    assert clock.now_s() >= now_s


def test_times_are_shown_in_utc_to_the_millisecond():
    assert iso(0.1234) == "1970-01-01T00:00:00.123Z"
