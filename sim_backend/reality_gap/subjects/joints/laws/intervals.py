"""Intervals of values: the error of a fit, and what is usual of the laws, which are not exact."""

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import LIMITED_TORQUE
from sim_backend.reality_gap.quantiles import Z_90

_SYSTEMATIC = 2.0
_SYSTEMATIC_SHARE = 0.1
"""Intervals are wider than the noise alone makes them, by a factor and by a share of the deviation: laws are not exact."""


def half_interval(key: str, value: float, start: float, error: float) -> float:
    """Half of a value's 90 % interval: the ``error`` of the fit alone and a usual imperfection of the laws.

    ``start`` is the nominal value, from which it is away by a cause; that of a limit is only some number far beyond.
    """
    off = value if key == LIMITED_TORQUE else value - start
    return float(np.hypot(Z_90 * _SYSTEMATIC * error, _SYSTEMATIC_SHARE * off))
