"""What may be wrong with the cube or its tracker, each hypothesis with the best number for a session and what that explains.

A session is a vector of numbers (``summary.py``) that scatters over healthy sessions with a known mean and covariance,
and two counts. A hypothesis says how the vector would move, in proportion to its numbers or along a table from replays; the gain
is how much more likely the session is with its best number than as a healthy one, in nats, less one for each further number.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.cube import COUNTED, KINDS, LINEAR, TABLED, Count, Kind, Linear, Tabled
from sim_backend.reality_gap.quantiles import Z_90
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES
from sim_backend.reality_gap.subjects.cube.counts import count_gain
from sim_backend.reality_gap.subjects.cube.offset import best_offset
from sim_backend.reality_gap.subjects.cube.summary import NAMES, CubeEvidence, CubeSummary, summary_of_evidence
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.reality_gap.subjects.cube.windows import LEAST_PUSHES
from sim_backend.reality_gap.verdict import AXES, Cause
from sim_backend.trifinger import constants as c

FINE = 400


@dataclass(frozen=True)
class Null:
    """How healthy sessions scatter.

    Attributes:
        mean: of the vector, shape (k,).
        covariance: shape (k, k).
        gap_mean: gaps per frame in healthy sessions.
        gap_variance: of a session's number of gaps, over its mean; 1 if they came as independently as can be.
        jump_mean: jumps per frame of a resting cube.
        jump_variance: as for gaps.
        jump_share: frames with jumps over the probability that a robot has, which is for cubes of which all faces are seen.
    """

    mean: np.ndarray
    covariance: np.ndarray
    gap_mean: float
    gap_variance: float
    jump_mean: float
    jump_variance: float
    jump_share: float


@dataclass(frozen=True)
class SeenCount:
    """A count of a session: events, in how many frames, and what is usual in healthy sessions.

    Attributes:
        count: of events.
        frames: in which they could be.
        usual: healthy rate per frame.
        spread: variance over mean of healthy counts.
        share: frames with events over the probability that a robot has.
    """

    count: int
    frames: int
    usual: float
    spread: float
    share: float


def seen_count(count: Count, tracker: TrackerStatistics, null: Null) -> SeenCount:
    """What was counted."""
    if count is Count.LOST_FRAMES:
        return SeenCount(tracker.gaps, tracker.frames + tracker.lost, null.gap_mean, null.gap_variance, 1.0)
    return SeenCount(tracker.jumps, tracker.jump_frames, null.jump_mean, null.jump_variance, null.jump_share)


@dataclass(frozen=True)
class Estimate:
    """One number of one effect, with its standard error."""

    effect: str
    parameter: str
    where: str
    value: float
    unit: str
    std: float

    def cause(self) -> Cause:
        """The same with its 90 % interval."""
        low, high = self.value - Z_90 * self.std, self.value + Z_90 * self.std
        return Cause(self.effect, self.parameter, self.where, self.value, self.unit, (low, high))


@dataclass(frozen=True)
class Judged:
    """A hypothesis at its best numbers.

    Attributes:
        gain: in nats over a healthy session, already less one for each further number.
        left: what it leaves of the whitened session, shape (kept,); all of it if it shows in a count.
    """

    effect: str
    gain: float
    estimates: tuple[Estimate, ...]
    left: np.ndarray

    def causes(self) -> tuple[Cause, ...]:
        """Its numbers as causes."""
        return tuple(estimate.cause() for estimate in self.estimates)


def sentence(causes: Iterable[Cause]) -> str:
    """Numbers in words, those of axes with the axis."""
    return ", ".join(f"{_name(cause)} {cause.value:.4g} ± {_half(cause):.2g} {cause.unit}".strip() for cause in causes)


def _name(cause: Cause) -> str:
    return f"{cause.parameter} {cause.where}" if cause.where in AXES else cause.parameter


def _half(cause: Cause) -> float:
    return 0.5 * (cause.interval_90[1] - cause.interval_90[0])


_EXPONENTIAL = {"log_delay_std", "log_interval", "log_noise_m", "log_noise_rad"}


@dataclass(frozen=True)
class WhitenedSession:
    """The numbers that a session has, with unit covariance where it is healthy."""

    kept: np.ndarray
    root: np.ndarray
    vector: np.ndarray

    def of(self, moved: np.ndarray) -> np.ndarray:
        """What a change of the whole vector (..., k) looks like, shape (..., kept)."""
        return np.linalg.solve(self.root, moved[..., self.kept].T).T


def whitened(summary: CubeSummary, null: Null) -> WhitenedSession:
    """A session as seen from healthy ones."""
    kept = np.flatnonzero(np.isfinite(summary.vector))
    root = np.linalg.cholesky(null.covariance[np.ix_(kept, kept)])
    return WhitenedSession(kept, root, np.linalg.solve(root, (summary.vector - null.mean)[kept]))


def judge(summary: CubeSummary, null: Null, without: Collection[str] = ()) -> list[Judged]:
    """Every hypothesis that the session can say something about, the best first; those in ``without`` are left out."""
    seen = whitened(summary, null)
    found = [_offset(row, summary, null, seen) if row.is_place else _linear(row, summary, null, seen) for row in LINEAR]
    found += [_tabled(row, summary, seen) for row in TABLED]
    rows = [row for row in (*found, *_counted(summary, null, seen.vector)) if row is not None and row.effect not in without]
    return sorted(rows, key=lambda judged: -judged.gain)


def largest_gains(ranking: Collection[Judged]) -> dict[Kind, float]:
    """Of each kind of hypotheses the largest gain, nats; 0 where there is none."""
    return {kind: max([row.gain for row in ranking if row.effect in effects], default=0.0) for kind, effects in KINDS.items()}


def farthest(seen: WhitenedSession, left: np.ndarray) -> dict[Kind, float]:
    """Of the tracker's numbers and of those of pushes how far off the farthest is for itself, standard deviations.

    A cause that moves one number alone hides in the misfit of all, among those that it leaves alone.

    Args:
        seen: a session.
        left: its vector, or what a hypothesis leaves of it, shape (kept,).
    """
    scores, pushed = _scores(seen, left), np.isin(np.array(NAMES)[seen.kept], CONTACT_NAMES)
    kinds = {Kind.TRACKER: scores[~pushed], Kind.PUSHES: scores[pushed]}
    return {kind: float(of_kind.max()) for kind, of_kind in kinds.items() if len(of_kind)}


def farthest_names(seen: WhitenedSession, left: np.ndarray) -> list[tuple[str, float]]:
    """The three numbers that are farthest off, each for itself, in standard deviations; arguments as of :func:`farthest`."""
    scores = _scores(seen, left)
    return [(NAMES[seen.kept[k]], float(scores[k])) for k in np.argsort(-scores)[:3]]


def _scores(seen: WhitenedSession, left: np.ndarray) -> np.ndarray:
    """How far off each kept number is for itself, standard deviations."""
    ways = seen.of(np.eye(len(NAMES))[seen.kept])
    return np.abs(ways @ left) / np.linalg.norm(ways, axis=1)


def without_worst(evidence: CubeEvidence, null: Null) -> CubeEvidence:
    """The evidence less the push without which least is left that neither health nor any one hypothesis explains.

    Whether a cube tips or turns hangs, in some pushes, on a tenth of a millimetre, and one such push would pass for a cause. All
    pushes are kept if there are few.
    """
    pushes = evidence.replayed
    if len(pushes) < LEAST_PUSHES:
        return evidence
    fewer = [replace(evidence, replayed=pushes[:i] + pushes[i + 1 :]) for i in range(len(pushes))]
    return min(fewer, key=lambda row: _unexplained(summary_of_evidence(row), null))


def _unexplained(summary: CubeSummary, null: Null) -> float:
    """Misfit, as a sum of squares, less what the best hypothesis about pushes explains of it."""
    seen = whitened(summary, null)
    return float(seen.vector @ seen.vector) - 2.0 * largest_gains(judge(summary, null))[Kind.PUSHES]


def _linear(row: Linear, summary: CubeSummary, null: Null, seen: WhitenedSession) -> Judged | None:
    moves = np.stack([moved_by(row, i, summary) for i in range(len(row.parameters))])
    columns = seen.of(moves).T
    said = np.linalg.norm(columns, axis=0) > 1e-12
    if not said.any():
        return None
    information = columns[:, said].T @ columns[:, said]
    towards = columns[:, said].T @ seen.vector
    best, std = np.linalg.solve(information, towards), np.sqrt(np.diag(np.linalg.inv(information)))
    if row.is_more:
        best = np.maximum(best, 0.0)  # each moves a number of its own
    gain = float(best @ towards - 0.5 * best @ information @ best) - float(said.sum() - 1)
    estimates = [_estimate(row, int(i), float(best[k]), float(std[k]), null) for k, i in enumerate(np.flatnonzero(said))]
    return Judged(row.effect, gain, tuple(estimates), seen.vector - columns[:, said] @ best)


def moved_by(row: Linear, i: int, summary: CubeSummary) -> np.ndarray:
    """How one unit of a hypothesis' number moves the vector, shape (k,)."""
    move = np.zeros(len(NAMES))
    for name, per_unit in row.moves[i].items():
        move[NAMES.index(name)] = per_unit
    trial = row.from_replays[i] if row.from_replays else None
    if trial is not None and summary.contact is not None:
        values, response = summary.contact.response[trial]
        away = values - row.nominal
        beside = np.flatnonzero(np.abs(away) < np.abs(away).min() * 1.001)
        move[-response.shape[1] :] = (response[beside] / away[beside, None]).mean(axis=0)
    return move


def _offset(row: Linear, summary: CubeSummary, null: Null, seen: WhitenedSession) -> Judged | None:
    """The best offset between those that were replayed, with its best height; without pushes the height alone."""
    height = seen.of(moved_by(row, 2, summary))
    if summary.contact is None or height @ height < 1e-12:
        return _linear(row, summary, null, seen)
    fine, ways = np.empty(0), []
    for trial in row.from_replays[:2]:
        values, moves = response_table(summary, str(trial), row.nominal)
        fine = np.linspace(values[0], values[-1], FINE)
        ways.append(np.stack([np.interp(fine, values, column) for column in seen.of(moves).T], axis=1))
    best, std, gain = best_offset(seen.vector, fine, ways[0], ways[1], height)
    estimates = [_estimate(row, i, float(best[i]), float(std[i]), null) for i in range(3)]
    across = [way[int(np.searchsorted(fine, value))] for way, value in zip(ways, best[:2], strict=True)]
    return Judged(row.effect, gain - 2.0, tuple(estimates), seen.vector - across[0] - across[1] - best[2] * height)


def _estimate(row: Linear, i: int, best: float, std: float, null: Null) -> Estimate:
    """The number itself: of logarithms against what is usual in healthy sessions, of others against nominal."""
    (parameter, where, unit), logarithm = row.parameters[i], next(iter(row.moves[i]), "")
    value = row.nominal + best
    if logarithm in _EXPONENTIAL:
        usual = float(np.exp(null.mean[NAMES.index(logarithm)]))
        value, std = usual * float(np.exp(best)), usual * float(np.exp(best)) * std
        if row.is_rate:
            value, std = 1.0 / (c.CAMERA_PERIOD_S * value), std / value / (c.CAMERA_PERIOD_S * value)
    else:
        value += row.usual
    return Estimate(row.effect, parameter, where, value, unit, std)


def _tabled(row: Tabled, summary: CubeSummary, seen: WhitenedSession) -> Judged | None:
    """The best value between those that were replayed; what the vector does between two of them is taken as linear."""
    if summary.contact is None:
        return None
    effect, parameter, where = row.effect, row.parameter, row.where
    values, moves = response_table(summary, effect)
    fine = np.linspace(values[0], values[-1], FINE)
    table = seen.of(moves)
    ways = np.stack([np.interp(fine, values, column) for column in table.T], axis=1)
    squares = ((seen.vector - ways) ** 2).sum(axis=1)
    k = int(squares.argmin())
    left, right = max(k - 1, 0), min(k + 1, FINE - 1)
    slope = np.linalg.norm(ways[right] - ways[left]) / (fine[right] - fine[left])
    gain = 0.5 * float(seen.vector @ seen.vector - squares[k])
    estimate = Estimate(effect, parameter, where, float(fine[k]), "", float(1.0 / max(slope, 1e-9)))
    return Judged(effect, gain, (estimate,), seen.vector - ways[k])


def response_table(summary: CubeSummary, effect: str, nominal: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Values (v,), increasing, with the nominal one among them, and how the vector moves at each, shape (v, k).

    A value beyond each end, twice as far from nominal, continues the last stretch, so that estimates do not end at the table's.
    """
    assert summary.contact is not None
    tried, response = summary.contact.response[effect]
    values, moves = np.append(tried, nominal), np.zeros((len(tried) + 1, len(NAMES)))
    moves[:-1, -response.shape[1] :] = response
    order = np.argsort(values)
    values, moves = values[order], moves[order]
    ends = []
    for end, inner in ((0, 1), (-1, -2)):
        beyond = max(2.0 * values[end] - nominal, 0.5 * values[end]) if nominal else 2.0 * values[end]
        slope = (moves[end] - moves[inner]) / (values[end] - values[inner])
        ends.append((beyond, moves[end] + slope * (beyond - values[end])))
    values = np.concatenate([[ends[0][0]], values, [ends[1][0]]])
    return values, np.concatenate([[ends[0][1]], moves, [ends[1][1]]])


def _counted(summary: CubeSummary, null: Null, left: np.ndarray) -> list[Judged]:
    if summary.tracker is None:
        return []
    found = []
    for row in COUNTED:
        seen = seen_count(row.count, summary.tracker, null)
        if not seen.frames:
            continue
        rate = seen.count / seen.frames
        value, std = rate / seen.share, float(np.sqrt(max(seen.count, 1))) / seen.frames / seen.share
        gain = count_gain(seen.count, seen.frames, seen.usual, seen.spread) if rate > seen.usual else 0.0
        found.append(Judged(row.effect, gain, (Estimate(row.effect, "probability", "camera", value, "", std),), left))
    return found
