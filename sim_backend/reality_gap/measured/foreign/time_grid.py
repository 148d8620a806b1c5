"""Samples as they came, put on a grid of equal steps: gaps stay gaps, and angles do not jump."""

from dataclasses import dataclass

import numpy as np

GAP_STEPS = 2.5
"""Up to so many steps without a sample are bridged; what lies in a longer gap is missing."""
_SNAP_STEPS = 1e-3  # a time stamp so near to a point of the grid is taken as that point
_TURN_RAD = 2.0 * np.pi


@dataclass(frozen=True)
class Grid:
    """Equal steps: ``count`` points from ``start_s``."""

    start_s: float
    step_s: float
    count: int

    @property
    def time_s(self) -> np.ndarray:
        """Shape (count,)."""
        return self.start_s + self.step_s * np.arange(self.count)


def grid_over(time_s: np.ndarray) -> Grid:
    """The grid over time stamps that do not decrease; equal ones count once, and at least two must differ.

    Its step is the median one, made exact by the mean of all steps that are within a fifth of the median: time stamps may be
    rounded, and a small error of the step would add up over the episode.
    """
    steps = np.diff(time_s)
    median_s = float(np.median(steps[steps > 0.0]))
    step_s = float(np.mean(steps[np.abs(steps - median_s) <= 0.2 * median_s]))
    count = int(np.floor((time_s[-1] - time_s[0]) / step_s + 0.01)) + 1
    return Grid(float(time_s[0]), step_s, count)


def interpolated(grid: Grid, time_s: np.ndarray, values: np.ndarray, *, own_rate: bool = False) -> np.ndarray:
    """Values on the grid by straight lines; NaN outside the samples and in gaps of more than ``GAP_STEPS`` steps.

    Args:
        grid: to put them on.
        time_s: of the samples, not decreasing, shape (s,); of equal ones the last counts.
        values: shape (s,), NaN for none.
        own_rate: whether a channel that is slower than the grid is bridged at its own rate.
    """
    time, samples = _finite(grid, time_s, values)
    if len(time) == 0:
        return np.full(grid.count, np.nan)
    points = grid.time_s
    right = np.clip(np.searchsorted(time, points), 0, len(time) - 1)
    left = np.where(time[right] == points, right, np.maximum(right - 1, 0))
    bridged = time[right] - time[left] <= _longest(grid, time, own_rate=own_rate)
    inside = (points >= time[0]) & (points <= time[-1])
    return np.where(inside & bridged, np.interp(points, time, samples), np.nan)


def held(grid: Grid, time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean over each step of values that hold until the next one comes, as commands do.

    A channel that is slower than the grid holds at its own rate; in a gap of more than ``GAP_STEPS`` of its steps a value
    holds for one step and is unknown from there on. Shapes as for :func:`interpolated`.
    """
    time, samples = _finite(grid, time_s, values)
    if len(time) == 0:
        return np.full(grid.count, np.nan)
    own_s = _own_step(grid, time)
    ends = np.append(time[1:], time[-1] + own_s)
    known_until = np.where(ends - time > _longest(grid, time, own_rate=True), time + own_s, ends)
    edges = np.append(time, max(ends[-1], grid.time_s[-1] + grid.step_s))
    integral = np.concatenate([[0.0], np.cumsum(samples * np.diff(edges))])
    points = grid.time_s
    means = (np.interp(points + grid.step_s, edges, integral) - np.interp(points, edges, integral)) / grid.step_s
    index = np.searchsorted(time, points, side="right") - 1
    known = (index >= 0) & (points < known_until[np.maximum(index, 0)])
    whole = np.interp(points, time, np.arange(len(time))) == index  # on a sample: exactly its value if it holds all the step
    lasts = points + grid.step_s <= edges[np.minimum(index + 1, len(time))] + _SNAP_STEPS * grid.step_s
    exact = samples[np.maximum(index, 0)]
    return np.where(known, np.where(whole & lasts, exact, means), np.nan)


def own_step_s(grid: Grid, time_s: np.ndarray, values: np.ndarray) -> float:
    """From one sample of a channel to the next, usually, but never less than the grid's step; NaN are no samples."""
    return _own_step(grid, _finite(grid, time_s, values)[0])


def jumps(time_s: np.ndarray, angle_rad: np.ndarray) -> bool:
    """Whether an angle jumps by more than half a turn between neighbouring samples, as a wrapped one does."""
    finite = np.isfinite(angle_rad)
    steps_s, steps_rad = np.diff(time_s[finite]), np.abs(np.diff(angle_rad[finite]))
    if len(steps_s) == 0:
        return False
    near = steps_s <= GAP_STEPS * max(float(np.median(steps_s)), 1e-12)
    return bool((steps_rad[near] > _TURN_RAD / 2.0).any())


def unwrapped(angle_rad: np.ndarray) -> np.ndarray:
    """The angle without jumps by turns; NaN stays NaN."""
    angle = angle_rad.copy()
    finite = np.isfinite(angle)
    angle[finite] = np.unwrap(angle[finite])
    return angle


def on_the_turn_of(angle_rad: np.ndarray, position_rad: np.ndarray) -> np.ndarray:
    """Angles moved by whole turns to lie within half a turn of positions; unchanged where one of them is NaN."""
    turns = np.round((position_rad - angle_rad) / _TURN_RAD)
    return angle_rad + _TURN_RAD * np.where(np.isfinite(turns), turns, 0.0)


def _finite(grid: Grid, time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples that are there, one for each time, on the grid's points where they are as good as on them."""
    there = np.isfinite(values)
    time, samples = time_s[there], values[there]
    if len(time) == 0:
        return time, samples
    nearest = np.round((time - grid.start_s) / grid.step_s)
    point = grid.start_s + grid.step_s * nearest
    time = np.where(np.abs(time - point) <= _SNAP_STEPS * grid.step_s, point, time)
    last = np.append(time[1:] > time[:-1], True)
    return time[last], samples[last]


def _own_step(grid: Grid, time: np.ndarray) -> float:
    return max(grid.step_s, float(np.median(np.diff(time))) if len(time) > 1 else 0.0)


def _longest(grid: Grid, time: np.ndarray, *, own_rate: bool) -> float:
    return GAP_STEPS * (_own_step(grid, time) if own_rate else grid.step_s) * (1.0 + 1e-6)
