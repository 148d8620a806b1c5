"""What motors make of a commanded torque where the measured one is recorded beside it: how late it comes, and where it ends.

Both columns say it directly, without any model of the arm. A measured torque that comes a row later says nothing of the motor:
many tables have in a row what was measured before its command. Nor is a torque that follows as through a filter one that comes
late: currents rise through a motor's coils, and boards smooth what they measure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter, lfilter_zi

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import LATE_TORQUE, LIMITED_TORQUE
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.laws.trajectory import filled_gaps
from sim_backend.reality_gap.subjects.joints.signs.changing_shares import changing_share
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.verdict import Cause, Doubt

_LONGEST_S = 0.2
"""Delays are looked for up to here."""
_EXPLAINED = 0.5
"""Share of what measured and commanded torque differ by that a delay or a limit must take away."""
_ROWS_OF_TABLE = 1
"""So many rows may lie between both because of how a table is written."""
_BEYOND, _LEAST_BEYOND = 1.15, 20
"""A limit is shown by so many rows whose command is so many times beyond it."""
_LIMITS = np.linspace(0.3, 0.995, 40)
"""Quantiles of the command's size at which a limit is looked for."""
_LEVEL = 0.01
"""A measured torque's own scale is not known better."""
_LEAST_ROWS = 200
_CLEARLY = 1.5
"""Times what a filter leaves (mean squares), beyond which what follows is no delay; as far below it, it is no filter."""
_UNLIKE = 0.05
"""Share of a measured torque that may differ from the commanded one for any reason."""
_TIME_CONSTANTS = np.geomspace(0.3, 1.5, 5)
"""Of filters that are tried, relative to the delay that explains most."""
_PARTS_OF_A_ROW = np.linspace(-0.75, 0.75, 7)
"""By which delays may lie between rows."""


@dataclass(frozen=True)
class Between:
    """One joint's commanded against its measured torque.

    Attributes:
        late_rows: rows by which the measured one follows best.
        limit_nm: where it ends, infinite if nothing shows a limit; with the standard error of that.
        limit_error_nm: 0 without a limit.
        may_be_filter: whether a filter of first or second order, or a moving mean, explains about as much as the delay.
        is_filter: whether one explains clearly more.
        unlike: what lasts of the difference that neither explains, root mean square, as a share of the measured torque's; 0 where
            it may be a filter.
    """

    late_rows: int
    limit_nm: float
    limit_error_nm: float
    may_be_filter: bool = False
    is_filter: bool = False
    unlike: float = 0.0


@dataclass(frozen=True)
class BetweenTorques:
    """What commanded and measured torques say of each other.

    Attributes:
        causes: delays and limits.
        doubts: of those that may be something else.
        open: what is left open, in sentences.
        unlike: sentences on what neither a delay nor a limit explains.
        smoothed: joints whose measured torque follows the commanded one as through a filter, each with what it is less for each
            rad/s and each rad/s^2: what a column seems to lack that is late by so much.
    """

    causes: Sequence[Cause]
    doubts: Sequence[Doubt]
    open: Sequence[str]
    unlike: Sequence[str]
    smoothed: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def between(sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], most_rows: int) -> Between | None:
    """Compare one joint's torques.

    Args:
        sent: of each recording, shape (s,), N m; NaN in gaps.
        measured: of the same rows.
        most_rows: of lateness.

    Returns:
        None where they cannot be compared: too few rows, or a command that does not change.
    """
    by_rows = [_paired(sent, measured, rows) for rows in range(most_rows + 1)]
    if len(by_rows[-1][0]) < _LEAST_ROWS or np.std(by_rows[0][0]) <= 0.0:
        return None
    ends = [_end(asked, felt) for asked, felt in by_rows]
    best = int(np.argmin([left for _, left in ends]))
    late = best if ends[best][1] < _EXPLAINED**2 * ends[0][1] else 0
    limit = ends[late][0]
    asked, felt = by_rows[late]
    looks = _looks_like_filter(sent, measured, limit, late) if late else (False, False)
    long = max(2, most_rows // 2)
    unlike = 0.0 if any(looks) else _lasting_share(np.clip(asked, -limit, limit), felt, long)
    if best and not late:  # no delay explains enough; a filter that is as slow may
        left, filtered, then_felt = _through(sent, measured, limit, _filters(best))
        if left < _EXPLAINED**2 * ends[0][1] or _lasting_share(filtered, then_felt, long) <= _UNLIKE < unlike:
            late, looks, unlike = best, (True, True), 0.0
    if not np.isfinite(limit):
        return Between(late, np.inf, 0.0, *looks, unlike)
    at_limit = np.abs(felt[np.abs(asked) > _BEYOND * limit])
    error = np.std(at_limit) / np.sqrt(len(at_limit)) + _LEVEL * np.median(at_limit)
    return Between(late, float(np.median(at_limit)), float(error), *looks, unlike)


def _paired(sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Commands and what was measured some rows after them, of all recordings."""
    asked = np.concatenate([series[: len(series) - rows] for series in sent])
    felt = np.concatenate([series[rows:] for series in measured])
    fine = np.isfinite(asked) & np.isfinite(felt)
    return asked[fine], felt[fine]


def _looks_like_filter(sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], limit: float, late: int) -> tuple[bool, bool]:
    """Whether a filter about as slow as a delay explains about as much, and whether it explains clearly more."""
    of_delay, of_filter = (_through(sent, measured, limit, each)[0] for each in (_delays(late), _filters(late)))
    return of_filter < _CLEARLY * of_delay, of_filter * _CLEARLY < of_delay


def _through(
    sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], limit: float, filters: Sequence[tuple[np.ndarray, np.ndarray]]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mean square left by the best of some filters, what comes through it, and what was measured then.

    Each filter is its numerator and denominator, as SciPy takes them.
    """
    cut, found = [np.clip(filled_gaps(series[:, None])[:, 0], -limit, limit) for series in sent], []
    for own in filters:
        through = [lfilter(*own, x, zi=x[0] * lfilter_zi(*own))[0] for x in cut]
        asked, felt = _paired(through, measured, 0)
        found.append((float(np.mean((felt - _share(asked, felt) * asked) ** 2)), asked, felt))
    return min(found, key=lambda each: each[0])


def _delays(late: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of about some rows, also between rows."""
    found = []
    for part in _PARTS_OF_A_ROW:
        rows, more = divmod(late + float(part), 1.0)
        weights = np.zeros(int(rows) + 2)
        weights[-2:] = 1.0 - more, more
        found.append((weights, np.ones(1)))
    return found


def _filters(late: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """About as slow as a delay of some rows: of first order, of second order (one after another one), and moving means."""
    found = []
    for rows in late * _TIME_CONSTANTS:
        once, twice = (-np.expm1(-1.0 / each) for each in (rows, 0.5 * rows))
        found.append((np.array([once]), np.array([1.0, once - 1.0])))
        found.append((np.array([twice**2]), np.convolve([1.0, twice - 1.0], [1.0, twice - 1.0])))
        width = max(2, round(2.0 * rows) + 1)
        found.append((np.full(width, 1.0 / width), np.ones(1)))
    return found


def _lasting_share(asked: np.ndarray, felt: np.ndarray, rows: int) -> float:
    """What lasts for some rows of the difference between two torques, but for a factor and a zero, as a share of the second."""
    beside = np.stack([asked, np.ones_like(asked)], axis=1)
    left = felt - beside @ np.linalg.lstsq(beside, felt, rcond=None)[0]
    parts = left[: len(left) // rows * rows].reshape(-1, rows)
    lasting = float(np.mean(parts.mean(axis=1) ** 2) - np.mean(parts.var(axis=1)) / max(1, rows - 1))
    return float(np.sqrt(max(0.0, lasting) / max(float(np.mean(felt**2)), 1e-30)))


def _share(asked: np.ndarray, felt: np.ndarray) -> float:
    return float(asked @ felt / max(float(asked @ asked), 1e-30))


def _end(asked: np.ndarray, felt: np.ndarray) -> tuple[float, float]:
    """Command beyond which the measured torque stays where it is, infinite where nothing shows one, and the mean square left."""
    left = float(np.mean((felt - _share(asked, felt) * asked) ** 2))
    order = np.argsort(np.abs(asked))
    size, along = np.abs(asked)[order], (np.sign(asked) * felt)[order]
    limits = np.quantile(size, _LIMITS)
    inside, beyond = (np.searchsorted(size, times * limits, side="right") for times in (1.0, _BEYOND))
    # sums over rows up to a limit and over those beyond it, which the limit cuts
    both, squares, rest = (np.concatenate([[0.0], np.cumsum(x)]) for x in (size * along, size**2, along))
    product = both[inside] + limits * (rest[-1] - rest[inside])
    square = squares[inside] + limits**2 * (len(size) - inside)
    with_it = (float(felt @ felt) - product**2 / np.maximum(square, 1e-30)) / len(size)
    with_it = np.where(len(size) - beyond >= _LEAST_BEYOND, with_it, np.inf)
    best = int(np.argmin(with_it))
    if with_it[best] >= _EXPLAINED**2 * left:
        return np.inf, left
    cut = np.clip(asked, -limits[best], limits[best])
    return float(limits[best]), float(np.mean((felt - _share(cut, felt) * cut) ** 2))


def causes_between(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> BetweenTorques:
    """Delays and limits between what was commanded and measured, what both leave open, and what neither explains.

    Args:
        episodes: of a study.
        names: of its joints.
    """
    causes, doubts, open_, unlike, smoothed = (
        list[Cause](),
        list[Doubt](),
        list[str](),
        list[str](),
        dict[str, tuple[float, float]](),
    )
    pairs = [(e.path.joints.commanded_torque_nm, e.path.joints.measured_torque_nm) for e in episodes]
    both = [(sent, felt) for sent, felt in pairs if sent is not None and felt is not None]
    if not both:
        return BetweenTorques(causes, doubts, open_, unlike)
    row_s = float(np.median([e.path.step_s for e in episodes]))
    compared = [(np.full_like(sent, np.nan), felt) for sent, felt in both]
    for j, name in enumerate(names):
        found = between([s[:, j] for s, _ in both], [m[:, j] for _, m in both], round(_LONGEST_S / row_s))
        if found is None:
            continue
        if found.is_filter:
            smoothed[name] = _less_by_motion(episodes, j)
            lateness = f"up to {1e3 * row_s * found.late_rows:.3g} ms"
            open_.append(
                f"whether torque of {name} is delayed by {lateness} or smoothed: what was measured follows as through a filter"
            )
        if found.late_rows > _ROWS_OF_TABLE and not found.is_filter:
            causes.append(_cause(LATE_TORQUE, name, row_s * (found.late_rows - 0.5), 0.25 * row_s))
            if found.may_be_filter:
                said = f"the measured torque of {name} is smoothed, which these data cannot tell from a delay"
                doubts.append(Doubt(causes[-1], said, "commanded torques that change at once, by steps"))
        elif found.late_rows and not found.is_filter:
            open_.append(
                f"whether {name} has an action delay of up to {1e3 * row_s:.3g} ms: its measured torque comes a row later"
            )
        if not found.may_be_filter and not np.isfinite(found.limit_nm):
            for (asked, _), (sent, _) in zip(compared, both, strict=True):
                asked[found.late_rows :, j] = sent[: len(sent) - found.late_rows, j]
        if found.unlike > _UNLIKE:
            unlike.append(
                f"the measured torque of {name} differs from the commanded one by {found.unlike:.0%} of it, and neither a "
                "delay nor a limit explains it"
            )
        if np.isfinite(found.limit_nm):
            causes.append(_cause(LIMITED_TORQUE, name, found.limit_nm, found.limit_error_nm))
    steps_s = [e.path.step_s for e, (sent, felt) in zip(episodes, pairs, strict=True) if sent is not None and felt is not None]
    shares = changing_share([asked for asked, _ in compared], [felt for _, felt in compared], steps_s)
    if shares is not None and not unlike:
        unlike.append(
            "measured torques are a share of the commanded ones that changes with time, at all joints alike: "
            f"{shares[0]:.0%} to {shares[1]:.0%} of what is usual"
        )
    return BetweenTorques(causes, doubts, open_, unlike, smoothed)


def _less_by_motion(episodes: Sequence[EpisodeEquations], joint: int) -> tuple[float, float]:
    """By how much the measured torque of a joint is less than the commanded one for each rad/s and rad/s^2; N m s/rad, kg m^2."""
    less, images = [], []
    for episode in episodes:
        path, signals = episode.path, episode.path.joints
        if signals.commanded_torque_nm is None or signals.measured_torque_nm is None:
            continue
        velocity = path.fast_velocity[:, joint]
        difference = signals.commanded_torque_nm[:, joint] - signals.measured_torque_nm[:, joint]
        known = np.isfinite(difference)
        less.append(difference[known])
        images.append(np.stack([velocity, np.gradient(velocity, path.step_s)], axis=1)[known])
    by_speed, by_change = np.linalg.lstsq(np.concatenate(images), np.concatenate(less), rcond=None)[0]
    return abs(float(by_speed)), abs(float(by_change))


def _cause(key: str, name: str, value: float, error: float) -> Cause:
    parameter, half = PARAMETERS[key], half_interval(key, value, PARAMETERS[key].absent, error)
    return Cause(key.partition(".")[0], parameter.name, name, value, parameter.unit, (value - half, value + half))
