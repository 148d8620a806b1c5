"""The interval of a success rate, the same wherever one is shown."""

import math
from functools import lru_cache
from statistics import NormalDist

SHOWN_LEVEL = 0.95
"""Of the intervals that people are shown, on pages and in the terminal."""
SHOWN = f"{100 * SHOWN_LEVEL:.0f} % interval"
"""What these are called."""
SHOWN_AT_EVERY_LOOK = f"{SHOWN} at every look"
"""What those are called that are shown while trials go on: confidence sequences, which hold however often one looks."""


def wilson(successes: int, trials: int, level: float) -> tuple[float, float]:
    """Wilson's score interval of a fraction, without continuity correction, two-sided at ``level``.

    Written out here because importing scipy.stats would hold up the whole process for a second at a job's end; a test
    compares the two. Source: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if trials == 0:
        return (0.0, 1.0)
    z = _quantile(level)
    rate = successes / trials
    centre = rate + z * z / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low = 0.0 if successes == 0 else (centre - half) / scale
    high = 1.0 if successes == trials else (centre + half) / scale
    return (low, high)


@lru_cache(maxsize=16)
def _quantile(level: float) -> float:
    """How many standard deviations to either side hold ``level`` of a normal law; boards ask hundreds of times."""
    return NormalDist().inv_cdf((1 + level) / 2)
