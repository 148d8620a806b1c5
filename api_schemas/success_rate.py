"""The interval of a success rate, the same wherever one is shown."""

import math
from statistics import NormalDist


def wilson(successes: int, trials: int, level: float) -> tuple[float, float]:
    """Wilson's score interval of a fraction, without continuity correction, two-sided at ``level``.

    Written out here because importing scipy.stats would hold up the whole process for a second at a job's end; a test
    compares the two. Source: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if trials == 0:
        return (0.0, 1.0)
    z = NormalDist().inv_cdf((1 + level) / 2)
    rate = successes / trials
    centre = rate + z * z / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low = 0.0 if successes == 0 else (centre - half) / scale
    high = 1.0 if successes == trials else (centre + half) / scale
    return (low, high)
