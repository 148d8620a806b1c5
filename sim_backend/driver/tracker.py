"""What reports the cube's pose: 10 Hz and 90 ms late, as on the real robot; without error on nominal robots."""

from dataclasses import dataclass

import numpy as np

from sim_backend.driver.driver import Segment
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class TrackedPose:
    """One report of the tracker for n robots: when the image was taken and when the pose arrived, in physics steps.

    Shapes (n, 3) in m, (n, 4) wxyz and (n,) between 0 and 1.
    """

    capture_step: int
    delivery_step: int
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    confidence: np.ndarray


class Tracker:
    """Turns true poses into late reports. Owner of the frames that are still on their way."""

    def __init__(self, *, physics_step_s: float = c.PHYSICS_STEP_S) -> None:
        self._period_steps = round(c.CAMERA_PERIOD_S / physics_step_s)
        self._delay_steps = round(c.CAMERA_DELAY_S / physics_step_s)
        self._under_way: list[TrackedPose] = []
        self._latest: TrackedPose | None = None

    def reset(self, cube_position_world_m: np.ndarray, cube_quat_wxyz: np.ndarray) -> TrackedPose:
        """Forget everything; the cube has rested where it is for at least one frame, which is returned."""
        self._under_way = []
        self._latest = self._frame(-self._period_steps, cube_position_world_m, cube_quat_wxyz)
        return self._latest

    def capture(self, segment: Segment) -> None:
        """Take the images that fall into a segment."""
        first, steps = segment.first_step, segment.cube_position_world_m.shape[1]
        for step in range(-(-first // self._period_steps) * self._period_steps, first + steps, self._period_steps):
            row = step - first
            frame = self._frame(step, segment.cube_position_world_m[:, row], segment.cube_quat_wxyz[:, row])
            self._under_way.append(frame)

    def deliver(self, step: int) -> list[TrackedPose]:
        """The reports that have arrived by ``step`` and were not delivered before, oldest first."""
        arrived = [frame for frame in self._under_way if frame.delivery_step <= step]
        if arrived:
            self._under_way = self._under_way[len(arrived) :]
            self._latest = arrived[-1]
        return arrived

    @property
    def latest(self) -> TrackedPose:
        """The newest report that has been delivered."""
        assert self._latest is not None, "reset the tracker first"
        return self._latest

    def _frame(self, step: int, position: np.ndarray, quat: np.ndarray) -> TrackedPose:
        return TrackedPose(step, step + self._delay_steps, position.copy(), quat.copy(), np.ones(len(position)))
