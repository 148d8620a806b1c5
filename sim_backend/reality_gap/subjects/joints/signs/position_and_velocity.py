"""What a sensor makes of speeds where positions are recorded beside them: a filter, told from a column that is late.

Both columns say it directly, whatever moves the joints. A velocity that is the mean of its row, or written a row later, says
nothing of the sensor; one that is late without being smoothed has no filter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import FILTERED_VELOCITY
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, filled_gaps
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.verdict import Cause

GATE = 12.0
"""Nats that a filter must gain, also over any delay."""
_ROWS_OF_TABLE = 1.5
"""So many rows a velocity may be late because of how it is computed and written; half a row early."""
_LONGEST_S = 0.2
_BESIDE = (0.0, 0.5, 1.0)
"""Rows that a filtered velocity may be late beside its filter."""
_EXPLAINED = 0.5
"""Share of what reported velocity and the slope of positions differ by that a filter must take away."""
_LEAST_NUMBERS = 50.0
_OTHER, _SURELY = 0.5, 4.0
"""A multiple of the slope further from 1 than this is another unit, sign or column, if it is so by so many standard errors."""

_Late = tuple[float, float]
"""How late, s, and the mean square that is left."""


@dataclass(frozen=True)
class Reported:
    """A joint's reported velocity against the slope of its positions.

    Attributes:
        numbers: independent ones that were compared.
        as_written: best delay within what tables make, and what it leaves.
        delayed: best delay at all.
        filtered: time constant of the best filter.
        filter_error_s: its standard error.
        multiple: of the slope, by as late as its best filter or delay, that it is nearest to.
        multiple_error: its standard error.
    """

    numbers: float
    as_written: _Late
    delayed: _Late
    filtered: _Late
    filter_error_s: float
    multiple: float
    multiple_error: float

    def gain_over(self, other: _Late) -> float:
        """What a filter gains over a delay, nats."""
        return 0.5 * self.numbers * float(np.log(other[1] / self.filtered[1]))

    @property
    def is_late(self) -> bool:
        """Whether it is later than tables make velocities, by a filter or not."""
        over = 0.5 * self.numbers * float(np.log(self.as_written[1] / min(self.filtered[1], self.delayed[1])))
        return over > GATE and self.filtered[0] > 0.0

    @property
    def is_other(self) -> bool:
        """Whether it is no velocity of this joint in this unit, however late."""
        return abs(self.multiple - 1.0) > _OTHER + _SURELY * self.multiple_error

    @property
    def is_filtered(self) -> bool:
        """Whether a filter explains it, and nothing else does as well."""
        explains = self.filtered[1] < (1.0 - _EXPLAINED) ** 2 * self.as_written[1]
        return self.is_late and explains and self.gain_over(self.delayed) > GATE


def reported(paths: Sequence[Trajectory], joint: int) -> Reported | None:
    """Compare a joint's columns; None where there is no velocity, or hardly any row.

    Args:
        paths: smoothed recordings.
        joint: index.
    """
    known = [path for path in paths if path.joints.velocity_rad_s is not None]
    if not known:
        return None
    row_s = known[0].step_s
    numbers = sum(2.0 * path.cutoff_hz * path.every * path.step_s * float(path.valid[:, joint].sum()) for path in known)
    if numbers < _LEAST_NUMBERS:
        return None
    slopes = [_slope(path, joint) for path in known]
    compared = [(path, _velocity(path, joint)) for path in known]

    def smoothed(late_s: float, filter_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Velocity, and the slope that is as late."""
        both = []
        for (path, velocity), slope in zip(compared, slopes, strict=True):
            seen = _through(slope(path.recording.time_s - late_s), filter_s / path.step_s)
            both.append([path.smoothed(each)[path.valid[:, joint]] for each in (velocity, seen)])
        velocities, seen = (np.concatenate([each[i] for each in both]) for i in range(2))
        return velocities, seen

    def left(late_s: float, filter_s: float = 0.0) -> float:
        velocities, seen = smoothed(late_s, filter_s)
        return max(float(np.mean((velocities - seen) ** 2)), 1e-24)

    as_written = _least(left, -0.5 * row_s, _ROWS_OF_TABLE * row_s)
    delayed = min(_least(left, -0.5 * row_s, _LONGEST_S), as_written, key=lambda found: found[1])
    each = [(*_least(lambda tau, d=rows * row_s: left(d, tau), 0.0, _LONGEST_S), rows * row_s) for rows in _BESIDE]
    filter_s, least, late_s = min(each, key=lambda found: found[1])
    by = max(0.05 * filter_s, 0.1 * row_s)
    bend = (left(late_s, filter_s + by) + left(late_s, max(filter_s - by, 0.0)) - 2.0 * least) / by**2
    error = float(np.sqrt(2.0 * least / (numbers * max(bend, 1e-30))))
    nearest = (late_s, filter_s) if least < delayed[1] else (delayed[0], 0.0)
    return Reported(
        numbers, as_written, delayed, (filter_s, least), min(error, filter_s), *_multiple(numbers, *smoothed(*nearest))
    )


def _multiple(numbers: float, velocity: np.ndarray, slope: np.ndarray) -> tuple[float, float]:
    """The multiple of a slope that a velocity is nearest to, and its standard error; 1 of a joint that keeps still."""
    square = float(np.mean(slope**2))
    if square == 0.0:
        return 1.0, np.inf
    multiple = float(np.mean(velocity * slope)) / square
    return multiple, float(np.sqrt(np.mean((velocity - multiple * slope) ** 2) / (numbers * square)))


def _least(left: Callable[[float], float], low: float, high: float) -> _Late:
    found = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * (high - low), "maxiter": 25})
    return float(found.x), float(found.fun)


def _velocity(path: Trajectory, joint: int) -> np.ndarray:
    assert path.joints.velocity_rad_s is not None
    return filled_gaps(path.joints.velocity_rad_s[:, [joint]])[:, 0]


def _slope(path: Trajectory, joint: int) -> Callable[[np.ndarray], np.ndarray]:
    """The slope of a joint's positions at any time."""
    return CubicSpline(path.recording.time_s, filled_gaps(path.joints.position_rad[:, [joint]])[:, 0]).derivative()


def _through(speed: np.ndarray, rows: float) -> np.ndarray:
    """A filter of first order with a time constant in rows, that begins at rest with what it sees."""
    if rows <= 0.0:
        return speed
    share, keep = 1.0 / (1.0 + 2.0 * rows), (1.0 - 2.0 * rows) / (1.0 + 2.0 * rows)
    return lfilter([share, share], [1.0, keep], speed, zi=[speed[0] * (1.0 - share)])[0]


def causes_of_velocities(
    episodes: Sequence[EpisodeEquations], names: Sequence[str]
) -> tuple[list[Cause], list[Cause], list[str]]:
    """Filters of velocities; those of velocities that may be late without one; and what is open about these.

    Args:
        episodes: of a study.
        names: of its joints.
    """
    causes, perhaps, open_ = list[Cause](), list[Cause](), list[str]()
    parameter = PARAMETERS[FILTERED_VELOCITY]
    effect = FILTERED_VELOCITY.partition(".")[0]
    for j, name in enumerate(names):
        found = reported([e.path for e in episodes], j)
        if found is not None and found.is_other:
            what = f"{found.multiple:.2g} times the slope of its positions, as nearly as it is any"
            open_.append(f"what the velocity of {name} is: {what}; check its column, its sign and its unit")
            continue
        if found is None or not found.is_late:
            continue
        value = (found.filtered if found.is_filtered else found.delayed)[0]
        half = half_interval(FILTERED_VELOCITY, value, 0.0, found.filter_error_s)
        filtered = Cause(effect, parameter.name, name, value, parameter.unit, (value - half, value + half))
        (causes if found.is_filtered else perhaps).append(filtered)
        if not found.is_filtered:
            late_ms, filter_ms = 1e3 * found.delayed[0], 1e3 * found.filtered[0]
            what = f"late by {late_ms:.2g} ms or filtered with {filter_ms:.2g} ms"
            open_.append(f"whether the velocity of {name} is {what}: neither explains it clearly better than the other")
    return causes, perhaps, open_
