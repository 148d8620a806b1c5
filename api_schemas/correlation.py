"""Does success follow the training step or the training reward? Spearman's correlation over rungs, with its interval."""

import math
from collections.abc import Sequence
from statistics import NormalDist

from api_schemas.schema import Schema

FEWEST = 4
"""With fewer rungs there is no interval."""


class Correlation(Schema):
    """Spearman's rank correlation of the rungs' success rates with ``of``, and its 80 and 95 % intervals over rungs."""

    of: str
    rungs: int
    estimate: float
    interval_80: tuple[float, float]
    interval_95: tuple[float, float]


def rank_correlation(of: str, values: Sequence[float], rates: Sequence[float]) -> Correlation | None:
    """The correlation; None with fewer than ``FEWEST`` rungs, or where either is the same for all.

    The interval is Fisher's with the variance of Bonett and Wright (Psychometrika 65 (2000) 23). Rungs with few trials make the
    correlation weaker than that of their true rates.
    """
    if len(values) < FEWEST or len(set(values)) == 1 or len(set(rates)) == 1:
        return None
    one, other = ranks(values), ranks(rates)
    middle = (len(values) + 1) / 2
    cross, first, second = (
        sum((a - middle) * (b - middle) for a, b in zip(x, y, strict=True)) for x, y in ((one, other), (one, one), (other, other))
    )
    estimate = max(-1.0, min(1.0, cross / math.sqrt(first * second)))
    return Correlation(
        of=of,
        rungs=len(values),
        estimate=estimate,
        interval_80=_interval(estimate, len(values), 0.80),
        interval_95=_interval(estimate, len(values), 0.95),
    )


def _interval(estimate: float, rungs: int, level: float) -> tuple[float, float]:
    if abs(estimate) <= 1 - 1e-12:
        return _fisher(estimate, rungs, level)
    # Fisher's transform ends here; the nearest that so many ranks can have but for one exchange
    low, high = _fisher(math.copysign(1 - 6 * 2 / (rungs * (rungs**2 - 1)), estimate), rungs, level)
    return (low, 1.0) if estimate > 0 else (-1.0, high)


def _fisher(estimate: float, rungs: int, level: float) -> tuple[float, float]:
    half = NormalDist().inv_cdf((1 + level) / 2) * math.sqrt((1 + estimate**2 / 2) / (rungs - 3))
    return math.tanh(math.atanh(estimate) - half), math.tanh(math.atanh(estimate) + half)


def ranks(values: Sequence[float]) -> list[float]:
    """From 1 on; equal values share the mean of their places."""
    ordered = sorted(values)
    return [ordered.index(value) + (ordered.count(value) + 1) / 2 for value in values]
