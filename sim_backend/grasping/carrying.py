"""A cube in the hand: the way it is carried, and what late reports of the camera say about it."""

import numpy as np

from sim_backend.trifinger import constants as c

SPEED_M_S = 0.12
UP_M = 0.025
"""How far the cube is lifted before it is carried aside."""
LOST_M, DROPPED_M = 0.03, 0.018
"""Further away, or that much lower than it is held, the cube is no longer in the hand."""
LOST_REPORTS = 2
"""One after the other; a single one may be an error of the camera."""
CORRECTION, LARGEST_CORRECTION_M = 0.4, 0.03
"""Share of what a report says is missing that is added to where the cube is held, and how much of it in all."""
BEGINNING = 5
"""Control periods, beside the report's own delay, before reports tell of a cube that is carried."""


class Carried:
    """Where the cube is asked to be: up, over, down to its goal. Owner of that way and of what has been corrected.

    Args:
        cube_m: where the cube is, shape (3,), m.
        goal_m: where it is to go, shape (3,), m.
        period_s: of the control.
    """

    def __init__(self, cube_m: np.ndarray, goal_m: np.ndarray, period_s: float) -> None:
        self._cube_m, self._period_s = cube_m, period_s
        self._asked_m: list[np.ndarray] = []  # without corrections, newest last
        self._correction_m = np.zeros(3)
        self._lost = 0
        self.aim(goal_m)

    def aim(self, goal_m: np.ndarray) -> None:
        """From here to another goal; what is in the air already is not lifted further than the goal asks."""
        lies = self._cube_m[2] < c.CUBE_REST_HEIGHT_M + UP_M / 2
        height = max(goal_m[2], self._cube_m[2] + (UP_M if lies else 0.0))
        self._way_m = [np.array([*self._cube_m[:2], height]), np.array([*goal_m[:2], height]), goal_m]
        self._arrived = False

    def go_on(self) -> np.ndarray:
        """A control period later: where to hold the cube, shape (3,), m."""
        way = self._way_m[0] - self._cube_m
        step, length = SPEED_M_S * self._period_s, float(np.linalg.norm(way))
        self._cube_m = self._cube_m + way * min(1.0, step / max(length, 1e-9))
        self._arrived = length <= step and len(self._way_m) == 1
        if length <= step and len(self._way_m) > 1:
            self._way_m.pop(0)
        self._asked_m.append(self._cube_m)
        return self._cube_m + self._correction_m

    def lost(self, reported_m: np.ndarray, delay_s: float) -> bool:
        """Whether the cube is no longer held, by a new report of where it was ``delay_s`` ago; at the goal it corrects, too."""
        late = round(delay_s / self._period_s)
        if len(self._asked_m) <= late + BEGINNING:
            return False
        missing_m = self._asked_m[-1 - late] - reported_m
        gone = missing_m[2] > DROPPED_M or np.linalg.norm(missing_m) > LOST_M
        self._lost = self._lost + 1 if gone else 0
        if self._arrived and not gone:
            more_m = self._correction_m + CORRECTION * missing_m
            self._correction_m = np.clip(more_m, -LARGEST_CORRECTION_M, LARGEST_CORRECTION_M)
        return self._lost >= LOST_REPORTS
