"""A robot asks for its next certificate in good time."""

import time

from robot_farm.admission import renewed
from robot_farm.bus_access import Access, clock_s


class Bus:
    def renew(self, access):
        self.access = access


def test_the_time_that_the_machine_slept_counts(monkeypatch):
    old, new, bus = Access((), "farm", renew_at_s=clock_s() + 3600.0), Access((), "farm"), Bus()
    assert renewed(old, lambda: new, bus, lambda _: None) is old
    real = time.clock_gettime
    slept_s = {time.CLOCK_BOOTTIME: 7200.0}
    monkeypatch.setattr(time, "clock_gettime", lambda clock: real(clock) + slept_s.get(clock, 0.0))
    assert renewed(old, lambda: new, bus, lambda _: None) is new
    assert bus.access is new
