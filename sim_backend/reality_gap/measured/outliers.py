"""Isolated samples that no motion and no motor makes: a glitch of the bus, a bit that was lost."""

import numpy as np
from scipy import ndimage

from sim_backend.reality_gap.measured.sensor_noise import position_noise

_SIGMAS = 12.0
"""Of the sensor's noise: noise, even one with heavy tails, stays below."""
_MOVES = 3.0
"""Of the moves around: at a bounce, a joint goes there and back by two of them."""
_AROUND = 5
_SPOILED = 3
"""Moves that a glitch of two samples makes itself."""
PEAK = 10.0
"""Largest torque over that which one sample in a thousand goes beyond: motors peak at 3 to 10 times what they can hold."""
_SELDOM = 1000


def position_outliers(position_rad: np.ndarray) -> np.ndarray:
    """Which samples lie far from those before and after, which agree with one another; one or two at a time.

    Args:
        position_rad: in the order of time, NaN for none, shape (s,).

    Returns:
        Shape (s,).
    """
    known = position_rad[np.isfinite(position_rad)]
    if len(known) <= 2 * _AROUND:
        return np.zeros(len(position_rad), dtype=bool)
    with np.errstate(over="ignore", invalid="ignore"):  # of a broken file anything may come
        return _apart(position_rad, _SIGMAS * float(position_noise(known[:, None])[0]))


def torque_outliers(torque_nm: np.ndarray) -> np.ndarray:
    """As :func:`position_outliers`, but only of torques that no motor gives: a short pulse may be meant; shapes (s,), N m."""
    often_nm = usual_peak_nm(torque_nm)
    if often_nm == 0.0:
        return np.zeros(len(torque_nm), dtype=bool)
    with np.errstate(over="ignore", invalid="ignore"):
        return _apart(torque_nm, PEAK * often_nm)


def usual_peak_nm(torque_nm: np.ndarray) -> float:
    """Size of the torque that one sample in a thousand goes beyond, but at least three, N m; NaN for none, shape (s,)."""
    known = np.sort(np.abs(torque_nm[np.isfinite(torque_nm)]))
    beyond = max(_SPOILED, len(known) // _SELDOM)
    return float(known[-1 - beyond]) if len(known) > beyond else 0.0


def _apart(series: np.ndarray, least: float) -> np.ndarray:
    """Samples further than ``least``, and than moves around, from the median of five."""
    found, known = np.zeros(len(series), dtype=bool), np.flatnonzero(np.isfinite(series))
    if len(known) <= 2 * _AROUND:
        return found
    values = series[known]
    off = np.abs(values - ndimage.median_filter(values, 5, mode="nearest"))
    moves = np.abs(np.diff(values, prepend=values[0]))
    usual = ndimage.rank_filter(moves, rank=-1 - _SPOILED, size=2 * _AROUND + 1, mode="nearest")
    found[known[off > np.maximum(least, _MOVES * usual)]] = True
    return found
