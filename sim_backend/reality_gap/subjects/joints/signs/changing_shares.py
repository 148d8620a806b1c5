"""Whether measured torques are a share of the commanded ones that changes with time, at all joints alike.

A supply that sags, or gives more than it should, does so at every motor at once. At a single one it may be small beside what
noise and a smoothed current make.
"""

from collections.abc import Sequence

import numpy as np

_PART_S = 0.5
"""The share is computed once in so many seconds."""
_LEAST_PARTS, _LEAST_JOINTS = 12, 2
_LEAST = 0.015
"""Share by which it must change, root mean square."""
_ERRORS = 4.0
"""And so many times its standard error."""
_ALIKE = 0.7
"""Share of what it changes by at single joints, beyond their noise, that must be the same at all of them."""


def changing_share(sent: Sequence[np.ndarray], measured: Sequence[np.ndarray], step_s: float) -> tuple[float, float] | None:
    """The smallest and the largest share, as one of ten parts of the recordings has it or less and more; None if it lasts.

    Args:
        sent: commanded torques of each recording, shape (s, k), N m; NaN in gaps, and of joints that are not compared.
        measured: of the same rows.
        step_s: between rows.
    """
    rows = max(2, round(_PART_S / step_s))
    found = [_by_part(asked, felt, rows) for asked, felt in zip(sent, measured, strict=True)]
    share, error = (np.concatenate([each[i] for each in found]) for i in (0, 1))
    is_known = np.isfinite(share) & np.isfinite(error)
    asked = is_known.sum(axis=0) >= _LEAST_PARTS
    if asked.sum() < _LEAST_JOINTS:
        return None
    share, weight = share[:, asked], np.where(is_known, 1.0 / np.square(np.where(is_known, error, 1.0)), 0.0)[:, asked]
    share = np.where(weight > 0.0, share, 0.0)
    usual = (weight * share).sum(axis=0) / weight.sum(axis=0)
    off = share / usual - 1.0
    weight = weight * usual**2
    told = (weight > 0.0).sum(axis=1) >= _LEAST_JOINTS
    off, weight = off[told], weight[told]
    if len(off) < _LEAST_PARTS:
        return None
    common = (weight * off).sum(axis=1) / weight.sum(axis=1)
    of_noise = 1.0 / weight.sum(axis=1)
    changes = float(np.mean(common**2) - np.mean(of_noise))
    beyond = (weight * off**2 - 1.0).sum(), (weight * (off - common[:, None]) ** 2 - 1.0).sum()
    is_alike = beyond[1] < (1.0 - _ALIKE) * beyond[0]
    if not is_alike or changes < max(_LEAST**2, _ERRORS**2 * float(np.median(of_noise))):
        return None
    least, most = np.quantile(1.0 + common, (0.1, 0.9))
    return float(least), float(most)


def _by_part(asked: np.ndarray, felt: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """By what share of the commanded torque the measured one goes up and down in each part, with standard errors, (n, k).

    A measured torque that comes somewhat late goes up and down by as much: what follows the change of the command counts, too.
    """
    parts = len(asked) // rows
    changes = np.gradient(asked, axis=0)
    asked, changes, felt = (each[: parts * rows].reshape(parts, rows, -1) for each in (asked, changes, felt))
    asked, changes, felt = (each - each.mean(axis=1, keepdims=True) for each in (asked, changes, felt))
    size = np.maximum((asked**2).sum(axis=1), 1e-30)
    across = changes - ((asked * changes).sum(axis=1) / size)[:, None] * asked
    along, beside = ((each * felt).sum(axis=1) for each in (asked, across))
    beside_size = np.maximum((across**2).sum(axis=1), 1e-30)
    left = (felt**2).sum(axis=1) - along**2 / size - beside**2 / beside_size
    share = np.sqrt(along**2 / size + beside**2 / beside_size) / np.sqrt(size)
    return share, np.sqrt(np.maximum(left / max(1, rows - 3), 1e-30) / size)
