"""Random numbers as a pure function of (seed, step, channel).

The same triple gives the same number in a trial, in a batch and inside the compiled control callback, whatever happened
before; nothing has to be carried along. The mixing function is the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
"""

import math

import numba
import numpy as np

MAX_SEED = 2**53 - 1
"""Seeds are kept in float64 slots, which hold integers exactly up to here."""
_TWO_PI = 2.0 * math.pi


@numba.njit(inline="always")
def _mixed(value: np.uint64) -> np.uint64:
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@numba.njit
def _bits(seed: float, step: float, channel: int) -> np.uint64:
    """64 mixed bits of the triple."""
    state = _mixed(np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15))
    state = _mixed(state ^ (np.uint64(np.int64(step)) * np.uint64(0xD1B54A32D192ED03)))
    return _mixed(state + np.uint64(channel + 1) * np.uint64(0x9E3779B97F4A7C15))


@numba.njit
def uniform(seed: float, step: float, channel: int) -> float:
    """A number in (0, 1), never 0 or 1.

    Args:
        seed: a whole number from 0 to ``MAX_SEED``.
        step: a whole number; may be negative.
        channel: a whole number of 0 or more; other channels are independent.
    """
    return (np.float64(_bits(seed, step, channel) >> np.uint64(12)) + 0.5) * (1.0 / 4503599627370496.0)


@numba.njit
def gaussian(seed: float, step: float, channel: int) -> float:
    """A number from the standard normal distribution (Box and Muller); arguments as for :func:`uniform`."""
    bits = _bits(seed, step, channel)
    radius = (np.float64(bits >> np.uint64(32)) + 0.5) * (1.0 / 4294967296.0)
    angle = (np.float64(bits & np.uint64(0xFFFFFFFF)) + 0.5) * (1.0 / 4294967296.0)
    return math.sqrt(-2.0 * math.log(radius)) * math.cos(_TWO_PI * angle)


@numba.njit
def gaussians(seeds: np.ndarray, steps: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """Standard normal numbers for n simulations.

    Args:
        seeds: shape (n,).
        steps: shape (n,).
        channels: shape (k,).

    Returns:
        Shape (n, k).
    """
    out = np.empty((len(seeds), len(channels)))
    for i in range(len(seeds)):
        for k in range(len(channels)):
            out[i, k] = gaussian(seeds[i], steps[i], channels[k])
    return out


@numba.njit
def uniforms(seeds: np.ndarray, steps: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """Numbers in (0, 1) for n simulations; shapes as for :func:`gaussians`."""
    out = np.empty((len(seeds), len(channels)))
    for i in range(len(seeds)):
        for k in range(len(channels)):
            out[i, k] = uniform(seeds[i], steps[i], channels[k])
    return out
