"""The numbers of hypotheses about pushes, beside what pushes were replayed with, and the fit of several of them at once.

A single hypothesis is looked at in ``hypotheses.py``. What several do to a session is taken as the sum of what each does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.cube import LINEAR, TABLED, USUAL_SIZES, Kind, Linear
from sim_backend.reality_gap.subjects.cube.hypotheses import FINE, WhitenedSession, moved_by, response_table
from sim_backend.reality_gap.subjects.cube.replayed_robot import ReplayedRobot, absent_values
from sim_backend.reality_gap.subjects.cube.summary import CubeSummary

_FARTHEST = {"m": 0.02, "": 0.1}
"""How far numbers are looked for that move a session in proportion, by their unit."""
_MOST_SWEEPS = 400


@dataclass(frozen=True)
class PushNumber:
    """One number of a hypothesis about pushes.

    Attributes:
        values: that are tried, increasing, shape (g,).
        ways: how each moves the whitened session, shape (g, k).
        rest: index of the value that changes nothing.
        sizes: how far each is from where the effect is absent, in what such numbers usually are off by, shape (g,).
    """

    values: np.ndarray
    ways: np.ndarray
    rest: int
    sizes: np.ndarray

    @property
    def slope(self) -> np.ndarray:
        """By how much one unit moves the session about rest, shape (k,)."""
        before, after = self.rest - 1, self.rest + 1
        return (self.ways[after] - self.ways[before]) / (self.values[after] - self.values[before])

    @property
    def per_size(self) -> float:
        """By how much one unit is more of the effect, in what such numbers usually are off by."""
        return float((self.sizes[-1] - self.sizes[0]) / (self.values[-1] - self.values[0]))


@dataclass(frozen=True)
class Fitted:
    """Numbers that together leave least of a session.

    Attributes:
        values: shape (n,).
        rests: those that change nothing, shape (n,).
        std: standard errors, each beside all others, shape (n,).
        half_left: half of the sum of squares that they leave, and of their sizes, nats.
    """

    values: np.ndarray
    rests: np.ndarray
    std: np.ndarray
    half_left: float


def numbers_of(summary: CubeSummary, seen: WhitenedSession, base: ReplayedRobot) -> dict[str, tuple[PushNumber, ...]]:
    """The numbers of each hypothesis about pushes, by effect; of a session with pushes, replayed with a base."""
    found: dict[str, tuple[PushNumber, ...]] = {}
    for tabled in TABLED:
        found[tabled.effect] = (_number(tabled.effect, 0, base, *_table(tabled.effect, 1.0, summary, seen)),)
    for row in LINEAR:
        if row.kind is Kind.PUSHES:
            ways = [_ways(row, i, summary, seen) for i in range(len(row.parameters))]
            found[row.effect] = tuple(_number(row.effect, i, base, *each) for i, each in enumerate(ways))
    return found


def _number(effect: str, i: int, base: ReplayedRobot, values: np.ndarray, ways: np.ndarray, nominal: float) -> PushNumber:
    now, absent = float(base.values(effect)[i]), float(absent_values(effect)[i])
    sizes = (now + base.unit_of(effect) * (values - nominal) - absent) / USUAL_SIZES[effect]
    return PushNumber(values, ways, int(np.searchsorted(values, nominal)), sizes)


def _table(trial: str, nominal: float, summary: CubeSummary, seen: WhitenedSession) -> tuple[np.ndarray, np.ndarray, float]:
    """Values, how each moves the session, and the one among them that does not."""
    values, moves = response_table(summary, trial, nominal)
    fine = np.union1d(np.linspace(values[0], values[-1], FINE), [nominal])
    return fine, np.stack([np.interp(fine, values, column) for column in seen.of(moves).T], axis=1), nominal


def _ways(row: Linear, i: int, summary: CubeSummary, seen: WhitenedSession) -> tuple[np.ndarray, np.ndarray, float]:
    """As :func:`_table`, of a number that may move the session in proportion."""
    if row.is_place and i < 2:
        return _table(str(row.from_replays[i]), row.nominal, summary, seen)
    far = _FARTHEST[row.parameters[i][2]]
    away = np.union1d(np.linspace(-far, far, FINE), [0.0])
    return row.nominal + away, np.outer(away, seen.of(moved_by(row, i, summary))), row.nominal


def fitted(vector: np.ndarray, numbers: Sequence[PushNumber]) -> Fitted:
    """The best values on their grids, one number after the other until none changes.

    Args:
        vector: the whitened session, shape (k,).
        numbers: n of them; with none the session is left as it is.
    """
    chosen = [number.rest for number in numbers]
    left = vector - sum((number.ways[number.rest] for number in numbers), np.zeros_like(vector))
    costs = [(number.ways**2).sum(axis=1) + number.sizes**2 for number in numbers]
    for _ in range(_MOST_SWEEPS):
        before = list(chosen)
        for i, number in enumerate(numbers):
            own = left + number.ways[chosen[i]]
            chosen[i] = int((costs[i] - 2.0 * number.ways @ own).argmin())
            left = own - number.ways[chosen[i]]
        if chosen == before:
            break
    values = np.array([number.values[k] for number, k in zip(numbers, chosen, strict=True)])
    rests = np.array([number.values[number.rest] for number in numbers])
    sizes = np.array([number.sizes[k] for number, k in zip(numbers, chosen, strict=True)])
    return Fitted(values, rests, _errors(numbers), 0.5 * float(left @ left + sizes @ sizes))


def _errors(numbers: Sequence[PushNumber]) -> np.ndarray:
    """Standard error of each number about rest, while all may be as far off as they usually are, shape (n,)."""
    if not numbers:
        return np.zeros(0)
    columns, usual = np.stack([number.slope for number in numbers], axis=1), np.array([number.per_size for number in numbers])
    scaled = columns / usual  # in usual sizes, of which the prior has unit variance
    return np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled + np.eye(len(numbers))))) / usual
