"""How large the noise of a sensor is, told from what it reports while it moves smoothly."""

from itertools import pairwise
from math import comb

import numpy as np

from sim_backend.reality_gap.quantiles import MEDIAN_SIZE

LEAST_NOISE_RAD = 3e-5
"""No encoder is trusted beyond this: laws of friction and gears do not hold to less, however quiet a simulated sensor is."""
_MOVES = 8.0
"""Times as large with every other row alone: white noise is as large there, that of a filter of second order up to 6 times as
large, and what smooth motion adds 16 times."""
_ORDERS, _SAME, _LEAST_ROWS = (6, 8, 10, 12), 1.15, 200
"""Higher differences; those count that are no larger than the next by more than chance makes them, of so many rows or more."""
_GROWS = 2.0
"""Times the noise of the slowest third of the samples that the quickest third has, where it grows with the speed."""


def position_noise(position_rad: np.ndarray) -> np.ndarray:
    """Standard deviation of the reported positions' errors, at least that of rounding to the smallest step, shape (k,)."""
    steps = []
    for column in position_rad.T:
        moves = np.abs(np.diff(column[~np.isnan(column)]))
        moves = moves[moves > 1e-12]
        steps.append(float(np.quantile(moves, 0.01)) if len(moves) else 0.0)
    return np.maximum(white_noise(position_rad), np.maximum(np.minimum(np.array(steps), 1e-3) / np.sqrt(12.0), LEAST_NOISE_RAD))


def encoder_step(position_rad: np.ndarray) -> np.ndarray:
    """The step in which positions come as they were reported, shapes (s, k) and (k,); 0 where they come in none.

    Positions that were put on another grid have lost it.
    """
    steps = []
    for column in position_rad.T:
        moves = np.abs(np.diff(column[~np.isnan(column)]))
        moves = moves[moves > 1e-9]
        if len(moves) < 20:
            steps.append(0.0)
            continue
        smallest = float(np.quantile(moves, 0.01))
        ratio = moves[moves < 30 * smallest] / smallest
        steps.append(smallest if np.median(np.abs(ratio - np.round(ratio))) < 0.01 else 0.0)
    return np.array(steps)


def white_noise(series: np.ndarray) -> np.ndarray:
    """Standard deviation of what is white in each column, from differences that smooth motion has next to none of; (k,).

    Fourth differences have none of motions that are slow beside the rate of the rows. Where they have, which shows in every
    other row alone, the first ones count that the next ones are as large as: of noise that is not white all are smaller than the
    ones before, and fourth ones stay. It is 0 where nothing is known.
    """
    level = _level_of(np.diff(series, 4, axis=0), 4)
    moves = _level_of(np.diff(series[::2], 4, axis=0), 4) > _MOVES * level
    for j in np.flatnonzero(moves) if len(series) >= _LEAST_ROWS else ():
        levels = [level[j], *(_level_of(np.diff(series[:, j : j + 1], order, axis=0), order)[0] for order in _ORDERS)]
        level[j] = next((own for own, higher in pairwise(levels) if 0.0 < own < _SAME * higher), level[j])
    return level


def grows_with_speed(series: np.ndarray) -> np.ndarray:
    """Whether each column's white noise is far larger where the column changes quickly than where it changes slowly, shape (k,).

    That of a sensor is not: so look positions whose time stamps are not exact, off by the speed times the error of the time.

    Args:
        series: of the sensor, shape (s, k).
    """
    differences, ways = np.diff(series, 4, axis=0), np.abs(series[4:] - series[:-4])
    ways[:, np.isnan(ways).all(axis=0)] = 0.0
    slow, quick = np.nanquantile(ways, [1.0 / 3.0, 2.0 / 3.0], axis=0)
    of_slow, of_quick = (_level_of(np.where(rows, differences, np.nan), 4) for rows in (ways <= slow, ways >= quick))
    return of_quick > _GROWS * np.maximum(of_slow, LEAST_NOISE_RAD)


def _level_of(differences: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation of white noise whose differences of an order these are, shapes (s, k) and (k,); 0 if none is known."""
    if not len(differences):
        return np.zeros(differences.shape[1])
    differences[:, np.isnan(differences).all(axis=0)] = 0.0
    return np.asarray(np.nanmedian(np.abs(differences), axis=0) / (MEDIAN_SIZE * np.sqrt(comb(2 * order, order))))
