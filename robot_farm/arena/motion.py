"""Scripted motion of a robot between trials, by position commands through the driver as a policy's would be."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from robot_farm.link.lease_keeper import TrialStoppedError
from sim_backend.driver.driver import Command
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.excitations.excitation import RAISED_RAD as RAISED_FINGER_RAD
from sim_backend.trifinger import constants as c

PERIOD_STEPS = 20
"""Scripts command at 50 Hz, the rate of the published policies."""
_PERIOD_S = PERIOD_STEPS * c.PHYSICS_STEP_S
_CATCH_UP = 0.15
"""Share of what a joint lags behind that is added to its target in each period, because the driver has no integral part: the
gravity of a stretched finger alone keeps it 0.03 rad from its target."""
_CATCH_UP_MAX_RAD = 0.04  # times the position gain: nearly the motor's whole torque

START_RAD = c.START_JOINT_POSITION_RAD
RAISED_RAD = np.tile(RAISED_FINGER_RAD, 3)
"""Fingers folded, tips 15 cm above the table: above any object that lies there, and out of the cameras' way."""


@dataclass
class Motion:
    """What is done with a robot (n = 1) outside trials; owner of what its tracker reported meanwhile.

    ``stop_reason`` is asked in every period; a text ends the motion.
    """

    driver: SimulatedDriver
    tracker: Tracker
    stop_reason: Callable[[], str | None] = lambda: None
    reports: list[TrackedPose] = field(default_factory=list)
    simulated_s: float = 0.0
    step: int = 0
    _catch_up_rad: np.ndarray = field(default_factory=lambda: np.zeros(9))

    def follow(self, course: Callable[[float], np.ndarray], duration_s: float) -> None:
        """Let the joints follow a course.

        Args:
            course: joint positions, shape (9,), rad, at a share of the duration between 0 and 1.
            duration_s: simulated time, s.

        Raises:
            TrialStoppedError: there was a reason to stop.
        """
        periods = max(1, round(duration_s / _PERIOD_S))
        for index in range(periods):
            self._advance(course((index + 1) / periods))

    def go_to(self, goal_rad: np.ndarray, duration_s: float) -> np.ndarray:
        """Move all joints to a pose, starting and ending gently; returns how far each is from it, shape (9,), rad."""
        from_rad = self.joint_position_rad
        self.follow(lambda share: from_rad + (goal_rad - from_rad) * share * share * (3 - 2 * share), duration_s)
        return self.joint_position_rad - goal_rad

    def hold(self, pose_rad: np.ndarray, duration_s: float) -> np.ndarray:
        """Stay in a pose; returns how far each joint is from it, shape (9,), rad."""
        self.follow(lambda _: pose_rad, duration_s)
        return self.joint_position_rad - pose_rad

    @property
    def joint_position_rad(self) -> np.ndarray:
        """What the encoders report now, shape (9,)."""
        return self.driver.measure().joint_position_rad[0]

    def _advance(self, wanted_rad: np.ndarray) -> None:
        reason = self.stop_reason()
        if reason is not None:
            raise TrialStoppedError(reason)
        lag_rad = wanted_rad - self.joint_position_rad
        self._catch_up_rad = np.clip(self._catch_up_rad + _CATCH_UP * lag_rad, -_CATCH_UP_MAX_RAD, _CATCH_UP_MAX_RAD)
        command = Command(np.zeros((1, 9)), (wanted_rad + self._catch_up_rad)[None])
        segment = self.driver.advance([(command, PERIOD_STEPS)])
        self.tracker.capture(segment)
        self.step = segment.first_step + PERIOD_STEPS
        self.reports += self.tracker.deliver(self.step)
        self.simulated_s += _PERIOD_S
