"""Whether measured torques are a share of the commanded ones that changes with time, at all joints alike.

A supply that sags, or gives more than it should, does so at every motor at once. At a single one it may be small beside what
noise and a smoothed current make.
"""

from collections.abc import Sequence

import numpy as np

_PART_S, _LEAST_ROWS = 0.5, 8
"""The share is computed once in so many seconds, which are so many rows at least."""
_LEAST_PARTS, _LEAST_JOINTS = 20, 2
_KNOWN = 0.03
"""Standard error up to which a share counts: of a joint that hardly moves it tells nothing."""
_LEAST = 0.015
"""Share by which it must change, root mean square."""
_ERRORS = 4.0
"""And so many times the standard error of that."""
_ALIKE = 0.7
"""Share of what it changes by at single joints, beyond their noise, that must be the same at all of them."""


def changing_share(
    sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], steps_s: Sequence[float]
) -> tuple[float, float] | None:
    """The smallest and the largest share, as one of ten parts of the recordings has it or less and more; None if it lasts.

    What depends on how large a torque is or how fast it changes is taken off: readings that are cut to whole steps, sensors
    behind a gear that rubs, and currents that are smoothed give less of small or fast torques.

    Args:
        sent: commanded torques of each recording, shape (s, k), N m; NaN in gaps, and of joints that are not compared.
        measured: of the same rows.
        steps_s: between rows of each recording.
    """
    zero_nm = _zeros_nm(np.concatenate(sent), np.concatenate(measured))
    found = [_by_part(asked, felt - zero_nm, step_s) for asked, felt, step_s in zip(sent, measured, steps_s, strict=True)]
    share, error, *beside = (np.concatenate([each[i] for each in found]) for i in range(5))
    with np.errstate(invalid="ignore"):
        is_known = np.isfinite(share) & (share > 0.0) & (error < _KNOWN * share)
    asked = np.flatnonzero(is_known.sum(axis=0) >= _LEAST_PARTS)
    off, noise = np.full((len(share), len(asked)), np.nan), np.zeros(len(asked))
    for column, j in enumerate(asked):
        known = is_known[:, j]
        by = np.stack([np.ones(known.sum()), *(each[known, j] for each in beside)], axis=1)
        by /= np.sqrt((by**2).mean(axis=0)) + 1e-30
        off[known, column] = (share[known, j] - by @ np.linalg.lstsq(by, share[known, j], rcond=None)[0]) / share[known, j].mean()
        noise[column] = np.mean((error[known, j] / share[known, j]) ** 2)
    together = np.isfinite(off).sum(axis=1) >= _LEAST_JOINTS
    if len(asked) < _LEAST_JOINTS or together.sum() < _LEAST_PARTS:
        return None
    off = off[together]
    same = _same(off)
    told = np.isfinite(off).any(axis=0)
    single = float(np.mean(np.nanmean(off[:, told] ** 2, axis=0) - noise[told]))
    least_error = float(np.std(same)) / np.sqrt(len(same))
    if np.mean(same) < max(_LEAST**2, _ERRORS * least_error, _ALIKE * single):
        return None
    least, most = np.quantile(1.0 + np.nanmean(off, axis=1), (0.1, 0.9))
    return float(least), float(most)


def _same(off: np.ndarray) -> np.ndarray:
    """Mean product of what two joints' shares are off in each part, all pairs alike, shape (n,): their noise is not the same."""
    known = np.isfinite(off)
    filled = np.where(known, off, 0.0)
    count = known.sum(axis=1)
    return (filled.sum(axis=1) ** 2 - (filled**2).sum(axis=1)) / (count * (count - 1))


def _zeros_nm(asked: np.ndarray, felt: np.ndarray) -> np.ndarray:
    """What sensors have where nothing is commanded, by a straight line through all rows, shape (k,)."""
    zeros = np.zeros(asked.shape[1])
    for j, (own, of_it) in enumerate(zip(asked.T, felt.T, strict=True)):
        fine = np.isfinite(own) & np.isfinite(of_it)
        if fine.any():
            zeros[j] = np.linalg.lstsq(np.stack([own[fine], np.ones(fine.sum())], axis=1), of_it[fine], rcond=None)[0][1]
    return zeros


def _by_part(asked: np.ndarray, felt: np.ndarray, step_s: float) -> tuple[np.ndarray, ...]:
    """By what share the measured torque of each part follows the commanded one, with its standard error, both of shape (n, k).

    Beside it what else such a share depends on, each of shape (n, k): one over the size of the commanded torque, as where
    readings are cut; the square of how fast it changes for its size; and what a wrong zero makes of it. A torque that comes
    somewhat late is no smaller: what follows the change of the command counts, too.
    """
    rows = max(_LEAST_ROWS, round(_PART_S / step_s))
    parts, joints = len(asked) // rows, asked.shape[1]
    if parts == 0:
        return (np.empty((0, joints)),) * 5
    changes = np.gradient(asked, step_s, axis=0)
    asked, changes, felt = (each[: parts * rows].reshape(parts, rows, joints) for each in (asked, changes, felt))
    squares = np.maximum((asked**2).sum(axis=1), 1e-30)
    across = changes - ((asked * changes).sum(axis=1) / squares)[:, None] * asked
    along, beside = ((each * felt).sum(axis=1) for each in (asked, across))
    across_squares = np.maximum((across**2).sum(axis=1), 1e-30)
    follows = along**2 / squares + beside**2 / across_squares
    left = np.maximum((felt**2).sum(axis=1) - follows, 1e-30) / (rows - 2)
    share, error = np.sqrt(follows / squares), np.sqrt(left / squares)
    return share, error, np.sqrt(rows / squares), (changes**2).sum(axis=1) / squares, asked.sum(axis=1) / squares
