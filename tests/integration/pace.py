"""Things sent bit by bit to a farm that gives up on what rests too long: where the machine stalls, it is right to."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Pace:
    """Of what is sent, with a look in between at whether the farm answers; knows how it went on."""

    def __init__(self, farm) -> None:
        self._farm = farm
        self._began_s = self._last_s = time.monotonic()
        self.longest_s = self.stalled_s = 0.0

    def rest(self, seconds: float) -> None:
        """Rests, and notes how long it really was, be it we who stalled or the farm."""
        time.sleep(seconds)
        self._farm.admin.get("/healthz")
        now_s = time.monotonic()
        took_s, self._last_s = now_s - self._last_s, now_s
        self.longest_s = max(self.longest_s, took_s)
        self.stalled_s += took_s if took_s > seconds + 0.5 else 0.0

    def was_kept(self, limit_s: float, whole_s: float = float("inf")) -> bool:
        """Whether no rest was as long as the farm's limit, nor the whole."""
        return self.longest_s < 0.9 * limit_s and self._last_s - self._began_s < 0.9 * whole_s


@contextmanager
def kept_open(farm, limit_s: float, whole_s: float = float("inf")) -> Iterator[Pace]:
    """What is sent within it must not be closed by the farm, unless a rest or the whole took longer than the farm's limit."""
    pace = Pace(farm)
    try:
        yield pace
    except (OSError, EOFError) as closed:
        pace.rest(0.0)
        assert not pace.was_kept(limit_s, whole_s), f"closed though something came every {pace.longest_s:.1f} s: {closed!r}"
        print(f"the machine stalled for {pace.longest_s:.1f} s: the farm was right to give up")
