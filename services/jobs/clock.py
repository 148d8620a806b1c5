"""The farm's clock: the wall's at the start, monotonic ever after, so that a jump of the wall's clock expires no lease."""

import time
from dataclasses import dataclass
from datetime import UTC, datetime


@dataclass(frozen=True)
class FarmClock:
    """Seconds since 1970 as of the start of this process, plus what has passed since."""

    started_s: float
    started_monotonic_s: float

    @classmethod
    def start(cls) -> "FarmClock":
        """Reads the wall's clock once."""
        return cls(time.time(), time.monotonic())

    def now_s(self) -> float:
        """Seconds; never goes back within one process."""
        return self.started_s + time.monotonic() - self.started_monotonic_s

    def now_iso(self) -> str:
        """The same moment for people, UTC."""
        return iso(self.now_s())


def iso(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601 in UTC, to the millisecond."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
