"""What a robot notices about itself in the middle of a trial, from nothing but what it measures."""

import numpy as np

from sim_backend.driver.driver import Segment
from sim_backend.trifinger import constants as c

JUMP_RAD = 0.1
"""No joint turns so far in a step of 1 ms: the fastest do 10 rad/s."""
SILENT_STEPS = 10
"""A controller that sends no torque to any joint for so long has restarted."""


class Alarm:
    """Looks at every segment of a trial (n = 1); owner of the last row that it saw.

    ``jump`` says which encoder jumped: it is off from then on, which nothing but a new homing mends.
    """

    def __init__(self) -> None:
        self._last_rad: np.ndarray | None = None
        self.jump: str | None = None

    def notice(self, segment: Segment) -> str | None:
        """What is wrong, as a sentence; None if nothing is."""
        rows = segment.joint_position_rad[0]
        rows = rows if self._last_rad is None else np.concatenate([self._last_rad[None], rows])
        self._last_rad = segment.joint_position_rad[0, -1]
        self.jump = self.jump or jumped(rows)
        return self.jump or _silent(segment)


def jumped(position_rad: np.ndarray) -> str | None:
    """Which encoder jumped between consecutive steps, or while the robot stood still; positions of shape (k, 9), rad."""
    moved_rad = position_rad[1:] - position_rad[:-1]
    if not moved_rad.size or (moved_rad.max() <= JUMP_RAD and moved_rad.min() >= -JUMP_RAD):
        return None
    step, joint = np.unravel_index(np.abs(moved_rad).argmax(), moved_rad.shape)
    return f"the encoder of joint {c.JOINT_NAMES[joint]} jumped by {moved_rad[step, joint]:+.2f} rad"


def _silent(segment: Segment) -> str | None:
    """A joint that moves is damped, so that torques of exactly zero mean that nobody drives it."""
    if segment.applied_torque_nm[0, -SILENT_STEPS:].all():
        return None  # quickly, in nearly every period
    sent, moving = segment.applied_torque_nm[0] != 0.0, segment.joint_velocity_rad_s[0] != 0.0
    silent = ~sent.any(axis=1) & moving.any(axis=1)
    if silent.sum() < SILENT_STEPS:
        return None
    return f"the controller sent no torque for {silent.sum()} ms of a control period: it restarted"
