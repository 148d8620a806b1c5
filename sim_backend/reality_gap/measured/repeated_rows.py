"""Rows that a logger wrote several times, since it runs faster than the sensors: repeats are no measurements."""

from collections.abc import Sequence

import numpy as np

_FEWEST_CHANGES = 20
_SINGLE_STEPS = 2.5
"""Times its smallest change that a channel usually changes by: one that goes by single steps of its encoder is slow, not held."""
_SELDOM = 0.01
"""Share of the changes that may come sooner than usual, as where two clocks drift past each other."""
_ALIKE = 1.5
"""Times as many rows may lie between samples of one channel as of another that is written with it."""


def rows_between_samples(values: np.ndarray) -> int:
    """Rows from one sample to the next of a channel that is written more often than it is measured; 1 if every row is a sample.

    Args:
        values: as recorded, shape (s,); NaN for none.
    """
    known = values[np.isfinite(values)]
    changes = np.abs(np.diff(known))
    places = np.flatnonzero(changes > 0.0)
    if len(places) <= _FEWEST_CHANGES:
        return 1
    rows, sizes = np.diff(places), changes[places]
    soonest = int(np.quantile(rows, _SELDOM, method="lower"))
    by_steps = np.median(sizes) < _SINGLE_STEPS * np.quantile(sizes, _SELDOM)
    return 1 if soonest < 2 or by_steps else int(np.median(rows))


def without_repeats(values: np.ndarray) -> np.ndarray:
    """A channel with NaN for each value that only repeats the sample before, shape (s,).

    Of a channel that stands still, as many values stay as it has samples.
    """
    every, found = rows_between_samples(values), values.copy()
    if every > 1:
        known = np.flatnonzero(np.isfinite(values))
        found[known[~_samples(np.diff(values[known]) != 0.0, every)]] = np.nan
    return found


def rows_that_are_samples(channels: Sequence[np.ndarray]) -> np.ndarray:
    """Rows that are no repeats of the row before in all that sensors report, shape (s,); all, unless every channel repeats.

    Args:
        channels: of all sensors, shapes (s,).
    """
    between = [rows_between_samples(each) for each in channels]
    if not between or min(between) < 2 or max(between) > _ALIKE * min(between):
        return np.ones(len(channels[0]) if channels else 0, dtype=bool)
    table = np.column_stack(channels)
    changes = ((table[1:] != table[:-1]) & ~(np.isnan(table[1:]) & np.isnan(table[:-1]))).any(axis=1)
    return _samples(changes, int(np.median(between)))


def _samples(changes: np.ndarray, every: int) -> np.ndarray:
    """Which rows are samples, shape (s,), of rows that differ from the one before where ``changes`` says so, shape (s - 1,)."""
    begins = np.flatnonzero(np.append(True, changes))
    lasts = np.diff(np.append(begins, len(changes) + 1))
    since = np.arange(len(changes) + 1) - np.repeat(begins, lasts)
    samples = np.repeat(np.maximum(1, np.round(lasts / every)), lasts)
    return (since % every == 0) & (since < samples * every)
