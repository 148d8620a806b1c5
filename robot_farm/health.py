"""How a robot is, for those who look at the farm: read from what it does anyway, so that looking costs no trial anything."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from api_schemas.robot import RobotHealth, SelfTest
from robot_farm.ideal_life import IdealLife
from robot_farm.life import Life
from robot_farm.run import Progress


@dataclass
class WatchedHealth:
    """Asked once a second by the heartbeat's thread; owns the last confidence and the time of the last self-test.

    Args:
        progress: gives that of the running trial, or of the last one.
        life: of the robot; an ideal one has neither temperatures nor tests.
    """

    progress: Callable[[], Progress]
    life: Life | IdealLife
    _confidence: float | None = None
    _tests_seen: int = 0
    _self_test: SelfTest | None = None

    def health(self) -> RobotHealth:
        """How the robot is now; a self-test is dated with the heartbeat that first tells of it."""
        tracked = self.progress().tracked
        if tracked is not None:
            self._confidence = _rounded(float(tracked.confidence[0]), 3)
        if self.life.tests_ended != self._tests_seen:
            self._tests_seen = self.life.tests_ended
            self._self_test = SelfTest(at=datetime.now(UTC).isoformat(timespec="seconds"), wrong=self.life.wrong)
        warmest_k = self.life.temperature_rise_k
        rise_k = None if warmest_k is None else _rounded(warmest_k, 1)
        return RobotHealth(motor_temperature_rise_k=rise_k, tracker_confidence=self._confidence, self_test=self._self_test)


def _rounded(value: float, digits: int) -> float | None:
    """A number as it is told; None for one that a diverging simulation left behind, so that the heartbeat goes on."""
    return round(value, digits) if math.isfinite(value) else None
