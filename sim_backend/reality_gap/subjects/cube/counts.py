"""Counts of a session, of lost frames and of jumps, against those of healthy sessions."""

from typing import Any

from scipy import stats


def count_gain(count: int, frames: int, usual: float, spread: float) -> float:
    """How much more likely a count is at its own rate than in a healthy session, nats.

    Args:
        count: of events.
        frames: in which they could be.
        usual: healthy rate per frame.
        spread: variance over mean of healthy counts; above 1 where robots differ.
    """
    mean = max(usual * frames, 1e-3)
    own = stats.poisson.logpmf(count, max(count, 1e-3))
    return max(float(own - healthy_count(mean, spread).logpmf(count)), 0.0)


def count_p(count: int, frames: int, usual: float, spread: float) -> float:
    """Probability of at least so many events in a healthy session; arguments as of :func:`count_gain`."""
    return float(healthy_count(max(usual * frames, 1e-3), spread).sf(count - 1))


def healthy_count(mean: float, spread: float) -> Any:
    """Distribution of a count over healthy sessions: Poisson, or broader where robots differ."""
    if spread <= 1.0 + 1e-6:
        return stats.poisson(mean)
    return stats.nbinom(mean / (spread - 1.0), 1.0 / spread)
