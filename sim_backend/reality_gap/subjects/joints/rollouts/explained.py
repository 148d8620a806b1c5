"""Whether causes take enough of an error to be its causes."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.limits import HealthyLimits
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit

EXPLAINED = 0.5
"""Share of a usual window's error that causes must take away at some joint to be named."""
_IN_LIMITS = 0.4
"""Share that causes may leave of an error at that joint which is as small as those of healthy robots at all joints.

Of an exact model of nine joints (tests/benchmarks/study_time.py) a friction by load at all joints takes one joint's error from
0.64 to 0.32 mrad: two programs compute the same friction differently. A friction by direction that was there took an arm's error
to 0.31 of what it was.
"""


def explained_at(nominal: RolloutFit, fit: RolloutFit, far_rad: np.ndarray | None) -> np.ndarray:
    """Whether causes take enough of an error to be named, by joint, shape (k,): half of it, or of far windows too far off.

    Where no joint is further off than healthy robots are it takes three fifths.

    Args:
        nominal: the model without causes.
        fit: the model with them.
        far_rad: what far windows of healthy robots may be off, shape (k,); None where no joint is further off than they are.
    """
    if far_rad is None:
        return fit.usual_rad < _IN_LIMITS * nominal.usual_rad
    is_far_off = nominal.far_rad > far_rad
    return is_halved(nominal.usual_rad, fit.usual_rad) | (is_far_off & is_halved(nominal.far_rad, fit.far_rad))


def explained_beside(nominal: RolloutFit, fit: RolloutFit, healthy: HealthyLimits, with_causes: HealthyLimits) -> np.ndarray:
    """Whether causes take enough of an error to be named beside healthy robots, by joint, shape (k,).

    Where few windows alone are off, half of that is enough only if no more is left than robots leave that have the causes: some
    law takes half of any event.

    Args:
        nominal: the model without causes.
        fit: the model with them.
        healthy: limits for the model without causes.
        with_causes: limits for the model with them.
    """
    is_event = healthy.hold_but_for_few(nominal) and not with_causes.hold(fit)
    return explained_at(nominal, fit, None if is_event or healthy.hold(nominal) else healthy.far_for(nominal))


def is_halved(before_rad: np.ndarray, after_rad: np.ndarray) -> np.ndarray:
    """Whether half of an error is gone, by joint, shape (k,)."""
    return after_rad < (1.0 - EXPLAINED) * before_rad
