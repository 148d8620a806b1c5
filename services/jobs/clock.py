"""The farm's clock: one for all processes that share a database, and no jump of this machine's own clock moves it."""

import time
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import select

from services.database.database import Database
from services.database.postgres import server_clock_s

READINGS = 3
WAITED_OUT_S = 1.0
"""If the database's clock goes back by no more, the farm's stands for as long; by more, and it goes back too."""


@dataclass
class FarmClock:
    """Seconds since 1970 as of the start of this process, plus what has passed since.

    With a database that others share, ``set_by`` it from time to time: leases are written and read by its clock.
    """

    started_s: float
    started_monotonic_s: float
    _latest_s: float = 0.0

    @classmethod
    def start(cls) -> "FarmClock":
        """Reads the wall's clock once."""
        return cls(time.time(), time.monotonic())

    def now_s(self) -> float:
        """Seconds; goes back only when ``set_by`` says so."""
        self._latest_s = max(self._latest_s, self._counted_s())
        return self._latest_s

    def _counted_s(self) -> float:
        return self.started_s + time.monotonic() - self.started_monotonic_s

    def now_iso(self) -> str:
        """The same moment for people, UTC."""
        return iso(self.now_s())

    async def set_by(self, database: Database) -> float:
        """Takes over the clock of the database's host, as near as its quickest answer of a few allows.

        Gives the seconds that the farm's clock went back by: 0, or more than ``WAITED_OUT_S``. If it stood for as long, no lease
        would end and no wish be told meanwhile, and processes that started later would go by another time.
        """
        read = min([await _reading(database) for _ in range(READINGS)], key=_took_s)
        before_s = self.now_s()
        self.started_s, self.started_monotonic_s, _ = read
        back_s = before_s - self._counted_s()
        if back_s <= WAITED_OUT_S:
            return 0.0
        self._latest_s = self._counted_s()
        return back_s


async def _reading(database: Database) -> tuple[float, float, float]:
    """What the database's clock said, what the monotonic one said halfway, and how long the answer took."""
    async with database.read() as connection:
        asked_s = time.monotonic()
        said_s = float((await connection.execute(select(server_clock_s()))).scalar_one())
        answered_s = time.monotonic()
    return said_s, (asked_s + answered_s) / 2, answered_s - asked_s


def _took_s(reading: tuple[float, float, float]) -> float:
    return reading[2]


def iso(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601 in UTC, to the millisecond."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
