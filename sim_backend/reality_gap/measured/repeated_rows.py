"""Samples that a logger wrote several times, since it runs faster than the sensor: repeats are no measurements."""

import numpy as np

_FEWEST_CHANGES = 20
_SINGLE_STEPS = 1.5
"""Times its smallest change that a channel usually changes by: one that goes by single steps of its encoder is slow, not held."""
_SELDOM = 0.01
"""Share of the changes that may come sooner than usual, as where two clocks drift past each other."""


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
    if every == 1:
        return found
    known = np.flatnonzero(np.isfinite(values))
    begins = np.flatnonzero(np.append(True, np.diff(values[known]) != 0.0))
    lasts = np.diff(np.append(begins, len(known)))
    since = np.arange(len(known)) - np.repeat(begins, lasts)
    samples = np.repeat(np.maximum(1, np.round(lasts / every)), lasts)
    found[known[(since % every != 0) | (since >= samples * every)]] = np.nan
    return found
