"""Where a finger's joints must be for its tip to be at a place, or near it if the finger does not reach so far."""

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad

_LOWER, _UPPER = c.SOFT_LIMIT_LOWER_RAD[:3], c.SOFT_LIMIT_UPPER_RAD[:3]
_AWAY_M = [(up, inward) for up in np.arange(0.0, 0.06, 0.004) for inward in (0.0, 0.004, 0.008, 0.012, 0.02)]
_TRIED_M = np.array([(sign * up, inward) for up, inward in _AWAY_M for sign in (1.0, -1.0)])
"""How far places that are tried instead lie above the wanted one and nearer to the arena's centre; the best first."""


def reach(finger: int, tip_world_m: np.ndarray) -> tuple[np.ndarray | None, float]:
    """Joint positions of one finger for its tip to be at a place, or at the nearest of those above, below and further in.

    Args:
        finger: 0, 1 or 2, in the order of ``constants.FINGER_NAMES``.
        tip_world_m: centre of the tip's sphere, shape (3,), m; not above the arena's very centre.

    Returns:
        Shape (3,), rad, within the soft limits, and how far the place was moved, m; (None, infinity) if none can be reached.
    """
    radius_m = np.hypot(tip_world_m[0], tip_world_m[1])
    shrink = 1.0 - _TRIED_M[:, 1:] / radius_m
    places = np.concatenate([tip_world_m[:2] * shrink, tip_world_m[2] + _TRIED_M[:, :1]], axis=1)
    joints = joint_position_rad(np.tile(places, 3))[:, 3 * finger : 3 * finger + 3]
    within = ((joints >= _LOWER) & (joints <= _UPPER)).all(axis=1)  # false where a joint is NaN
    if not within.any():
        return None, float("inf")
    first = int(within.argmax())
    return joints[first], float(np.abs(_TRIED_M[first]).sum())
