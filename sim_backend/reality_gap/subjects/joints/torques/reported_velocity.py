"""The velocity equation: the reported velocity is the derivative of the reported position, through the board's filter."""

import numpy as np
from scipy import signal

from sim_backend.reality_gap.knowledge.joint_effects import Channel, keys_of
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, filled_gaps

SHOWN = keys_of(Channel.VELOCITY)
"""Time constants of first-order filters, one after the other: what stands between a speed and its report."""


def velocity_residual(path: Trajectory, state: JointState, *, is_mean: bool) -> np.ndarray | None:
    """Residual of the reported velocity, shape (t, k), rad/s; None without such a channel.

    Args:
        path: the smoothed episode.
        state: the present model.
        is_mean: whether the robot reports the mean speed since the last sample, as TriFingers do.
    """
    reported = path.joints.velocity_rad_s
    if reported is None:
        return None
    speed = path.fast_velocity
    if is_mean:
        speed = 0.5 * (speed + np.concatenate([speed[:1], speed[:-1]]))
    for key in SHOWN:
        speed = _lagged(speed, state.value(key), path.step_s)
    return path.smoothed((filled_gaps(reported) - speed).T).T


def velocity_image(path: Trajectory, state: JointState, term: Term) -> np.ndarray:
    """What a filter's time constant adds to its joint's residual, shape (t,), rad/s per s."""
    constant = state.value(term.key)[term.index]
    series = path.fast_velocity[:, [term.index] * 2]
    pair = _lagged(series, np.array([constant, constant + term.probe]), path.step_s)
    return path.smoothed(pair[:, 1] - pair[:, 0]) / term.probe


def _lagged(series: np.ndarray, time_constant_s: np.ndarray, step_s: float) -> np.ndarray:
    """The catalogue's first-order filter for each column, shape (s, k)."""
    share = step_s / (time_constant_s + step_s)
    columns = zip(share, series.T, strict=True)
    return np.stack([signal.lfilter([a], [1.0, a - 1.0], x, zi=[x[0] * (1.0 - a)])[0] for a, x in columns], axis=1)
