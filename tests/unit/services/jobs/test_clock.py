import time

from services.jobs.clock import FarmClock, iso


def test_a_jump_of_the_walls_clock_does_not_move_the_farms(monkeypatch):
    clock = FarmClock.start()
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert abs(clock.now_s() - clock.started_s) < 1


def test_times_are_shown_in_utc_to_the_millisecond():
    assert iso(0.1234) == "1970-01-01T00:00:00.123Z"
