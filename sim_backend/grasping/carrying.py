"""A cube in the hand: the way it is carried, and what late reports of the camera say about it."""

import numpy as np

from sim_backend.grasping.turning import wrapped
from sim_backend.trifinger import constants as c

SPEED_M_S, TURNING_RAD_S = 0.12, 1.5
UP_M = 0.025
"""How far the cube is lifted before it is carried aside."""
LOST_M, DROPPED_M = 0.03, 0.018
"""Further away, or that much lower than it is held, the cube is no longer in the hand."""
LOST_REPORTS = 2
"""One after the other; a single one may be an error of the camera."""
CORRECTION, LARGEST_CORRECTION_M, LARGEST_CORRECTION_RAD = 0.4, 0.03, 0.35
"""Share of what a report says is missing that is added to where the cube is held, and how much of it in all."""
SLIPPED_RAD, SLIPPED_REPORTS = 0.26, 10
"""That far from the turn it was given, for so many reports at its goal, the cube does not follow the hand."""
BEGINNING = 5
"""Control periods, beside the report's own delay, before reports tell of a cube that is carried."""


class Carried:
    """Where the cube is asked to be: up, over and round, down to its goal. Owner of that way and of what has been corrected.

    Args:
        cube_m: where the cube is, shape (3,), m.
        goal_m: where it is to go, shape (3,), m.
        period_s: of the control.
        turn_rad: how far it is to be turned about the vertical through its centre.

    ``arrived`` is whether it is asked to be at its goal.
    """

    def __init__(self, cube_m: np.ndarray, goal_m: np.ndarray, period_s: float, turn_rad: float = 0.0) -> None:
        self._cube_m, self._period_s, self._turned_rad = cube_m, period_s, 0.0
        self._asked_m: list[np.ndarray] = []  # without corrections, newest last
        self._asked_rad: list[float] = []
        self._correction_m, self._correction_rad = np.zeros(3), 0.0
        self._lost = 0
        self.aim(goal_m, turn_rad)

    def aim(self, goal_m: np.ndarray, turn_rad: float = 0.0) -> None:
        """From here to another goal; what is in the air already is not lifted further than the goal asks."""
        lies = self._cube_m[2] < c.CUBE_REST_HEIGHT_M + UP_M / 2
        height = max(goal_m[2], self._cube_m[2] + (UP_M if lies else 0.0))
        self._way_m = [np.array([*self._cube_m[:2], height]), np.array([*goal_m[:2], height]), goal_m]
        self._turn_rad, self.arrived, self._slipped = turn_rad, False, 0

    def go_on(self) -> np.ndarray:
        """A control period later: where to hold the cube, shape (3,), m."""
        way = self._way_m[0] - self._cube_m
        step, length = SPEED_M_S * self._period_s, float(np.linalg.norm(way))
        self._cube_m = self._cube_m + way * min(1.0, step / max(length, 1e-9))
        self.arrived = length <= step and len(self._way_m) == 1
        if len(self._way_m) == 2:  # not while it may touch the floor
            most = TURNING_RAD_S * self._period_s
            self._turned_rad = float(np.clip(self._turn_rad, self._turned_rad - most, self._turned_rad + most))
        if length <= step and len(self._way_m) > 1 and (len(self._way_m) > 2 or self._turned_rad == self._turn_rad):
            self._way_m.pop(0)
        self._asked_m.append(self._cube_m)
        self._asked_rad.append(self._turned_rad)
        return self._cube_m + self._correction_m

    @property
    def asked_m(self) -> np.ndarray:
        """Where the cube is asked to be now, corrections left out, shape (3,), m."""
        return self._cube_m

    @property
    def turned_rad(self) -> float:
        """How far to hold the cube turned from how it was taken."""
        return self._turned_rad + self._correction_rad

    @property
    def slipped(self) -> bool:
        """Whether the cube, at its goal, has long not been turned as it was to be."""
        return self._slipped >= SLIPPED_REPORTS

    def lost(self, reported_m: np.ndarray, delay_s: float, reported_rad: float = 0.0) -> bool:
        """Whether the cube is no longer held, by a new report of the camera; at the goal it corrects, too.

        Args:
            reported_m: where it was, shape (3,), m.
            delay_s: how long ago.
            reported_rad: how far it was turned then from how it was taken.
        """
        late = round(delay_s / self._period_s)
        if len(self._asked_m) <= late + BEGINNING:
            return False
        missing_m = self._asked_m[-1 - late] - reported_m
        gone = missing_m[2] > DROPPED_M or np.linalg.norm(missing_m) > LOST_M
        self._lost = self._lost + 1 if gone else 0
        if self.arrived and not gone:
            more_m = self._correction_m + CORRECTION * missing_m
            self._correction_m = np.clip(more_m, -LARGEST_CORRECTION_M, LARGEST_CORRECTION_M)
            missing_rad = wrapped(self._asked_rad[-1 - late] - reported_rad)
            self._slipped = self._slipped + 1 if abs(missing_rad) > SLIPPED_RAD else 0
            more_rad = self._correction_rad + CORRECTION * missing_rad
            self._correction_rad = float(np.clip(more_rad, -LARGEST_CORRECTION_RAD, LARGEST_CORRECTION_RAD))
        return self._lost >= LOST_REPORTS
