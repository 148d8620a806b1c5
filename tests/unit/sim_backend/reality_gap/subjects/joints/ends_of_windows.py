"""Fits of which nothing is known but how far off their windows end up."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit

_NOBODY = np.empty(0)


def fit_of(off_rad: np.ndarray) -> RolloutFit:
    """A fit whose windows end up as far off as this, shape (n, k)."""
    return RolloutFit(None, (), 0, _NOBODY, _NOBODY, np.square(off_rad), (_NOBODY, _NOBODY))  # pyrefly: ignore[bad-argument-type]
