"""The distribution that the variance between robots is judged by."""

import math
from statistics import NormalDist

import numpy as np

NEARLY_NORMAL = 1e4


def noncentral_chi_square(x: float, free: float, noncentrality: float) -> float:
    """The probability that a noncentral chi-square variable with ``free`` degrees of freedom is at most ``x``.

    A sum over central ones, weighted by Poisson's law (Johnson, Kotz and Balakrishnan, Continuous Univariate Distributions 2,
    chapter 29); beyond a noncentrality of ``NEARLY_NORMAL``, the normal distribution of the same mean and variance. Written out
    for the same reason as ``wilson``, and compared with scipy's in a test.
    """
    if x <= 0:
        return 0.0
    if noncentrality > NEARLY_NORMAL:
        return NormalDist(free + noncentrality, math.sqrt(2 * free + 4 * noncentrality)).cdf(x)
    half, rate = x / 2, max(noncentrality / 2, 1e-300)
    most = max(half, rate)
    index = np.arange(int(most + 12 * math.sqrt(most) + 60), dtype=float)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(index[1:]))])
    log_gamma = math.lgamma(free / 2 + 1) + np.concatenate([[0.0], np.cumsum(np.log(free / 2 + index[1:]))])
    # The central distribution of index j is the sum of these terms from j on.
    terms = np.exp((free / 2 + index) * math.log(half) - half - log_gamma)
    central = np.cumsum(terms[::-1])[::-1]
    return float(np.exp(index * math.log(rate) - rate - log_factorial) @ central)
