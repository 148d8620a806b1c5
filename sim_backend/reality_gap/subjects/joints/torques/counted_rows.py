"""Which rows of the mechanics count: those in which the motor alone moves a joint that does move. And which joints are lively."""

import numpy as np

from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, near_gaps

STANDSTILL_RAD_S = 0.02
"""Below it friction may hold anything, so that mechanics says nothing."""
LIVELY = 8.0
"""Acceleration over what noise makes of it through the controller: then less than a sixtieth of its power is noise."""
_STILL_S = 0.03
_MEAN_S, _REVERSAL_S = 0.005, 0.02
"""A torque's sign is that of its mean over so long; so long before and after a change of it a rotor may be on its way."""
_NEAR_END_RAD = 0.012
_NEAR_END_S = 0.06


def measured(path: Trajectory, torque_known: np.ndarray, same_tree: np.ndarray) -> np.ndarray:
    """Rows in which a joint's torque and the positions of all joints that it moves with were measured, not filled in.

    Args:
        path: the smoothed episode.
        torque_known: samples with a torque, shape (s, k).
        same_tree: which joints feel which, shape (k, k).

    Returns:
        Shape (t, k).
    """
    torque = ~near_gaps(~torque_known, path.step_s, path.cutoff_hz)[:: path.every]
    moving = np.stack([path.valid[:, tree].all(axis=1) for tree in same_tree], axis=1)
    return moving & torque


def rests(path: Trajectory) -> np.ndarray:
    """Rows around which a joint stands still for most of the time, shape (t, k)."""
    speed, width = np.abs(path.fast_velocity), max(1, round(_STILL_S / path.step_s))
    share = _moving_mean((speed < STANDSTILL_RAD_S).astype(float), width)
    return share[:: path.every] > 0.5


def pauses(path: Trajectory) -> np.ndarray:
    """Rows around which a joint stands still at any time, shape (t, k)."""
    width = max(1, round(_STILL_S / path.step_s))
    return (_moving_mean((np.abs(path.fast_velocity) < STANDSTILL_RAD_S).astype(float), width) > 1e-9)[:: path.every]


def reverses(path: Trajectory, torque_nm: np.ndarray) -> np.ndarray:
    """Rows around which a motor's torque changes its sign, so that a gear with play lets the rotor go, shape (t, k).

    Args:
        path: the smoothed episode.
        torque_nm: of the motors, shape (k, s).
    """
    sign = np.sign(_moving_mean(torque_nm.T, max(1, round(_MEAN_S / path.step_s))))
    changes = np.diff(sign, axis=0, prepend=sign[:1]) != 0.0
    width = max(1, round(2.0 * _REVERSAL_S / path.step_s))
    return (_moving_mean(changes.astype(float), width) > 1e-9)[:: path.every]


def near_end(path: Trajectory, ends_rad: np.ndarray) -> np.ndarray:
    """Rows around which a joint comes near an end of its range, where something else than the motor acts.

    Args:
        path: the smoothed episode.
        ends_rad: of the joints' ranges, shape (k, 2).

    Returns:
        Shape (t, k).
    """
    return near_end_samples(path, ends_rad)[:: path.every]


def near_end_samples(path: Trajectory, ends_rad: np.ndarray) -> np.ndarray:
    """The same of every sample, shape (s, k)."""
    q = path.fast_position
    near = (q < ends_rad[:, 0] + _NEAR_END_RAD) | (q > ends_rad[:, 1] - _NEAR_END_RAD)
    width = max(1, round(2 * _NEAR_END_S / path.step_s))
    return _moving_mean(near.astype(float), width) > 1e-9


def is_lively(path: Trajectory, torque_nm: np.ndarray, inertia_kg_m2: np.ndarray) -> np.ndarray:
    """Whether joints accelerate far more than for noise that the controller feeds back, shape (k,).

    Where they do not, the noise of the reported velocity is what moves them: it stands in the velocity's equation together with
    the motion that it makes, and would look like a filter, or like an error that follows the speed.

    Args:
        path: the smoothed episode.
        torque_nm: that was sent, shape (k, s).
        inertia_kg_m2: of each joint, shape (k,).
    """
    noise = path.smoothed_noise(white_noise(torque_nm.T)) / inertia_kg_m2
    counted = np.where(path.valid, path.acceleration, np.nan)
    size = np.sqrt(np.nansum(counted**2, axis=0) / np.maximum(path.valid.sum(axis=0), 1))
    return size > LIVELY * noise


def _moving_mean(series: np.ndarray, width: int) -> np.ndarray:
    """Over ``width`` samples around each, along the first axis."""
    padded = np.concatenate([np.zeros((1, series.shape[1])), np.cumsum(series, axis=0)])
    low, high = np.arange(len(series)) - width // 2, np.arange(len(series)) + width // 2 + 1
    low, high = np.clip(low, 0, len(series)), np.clip(high, 0, len(series))
    return (padded[high] - padded[low]) / (high - low)[:, None]
