"""A recorded motion made fit for differentiation: gaps filled, smoothed without a shift in time, and thinned out."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import signal

from sim_backend.reality_gap.knowledge.known_of_robot import CUTOFF_HZ
from sim_backend.reality_gap.measured.sensor_noise import encoder_step, position_noise
from sim_backend.reality_gap.recording import JointSignals, Recording, RecordingError

ORDER = 4
FAST_CUTOFF_HZ = 60.0
"""For the direction of motion, which friction switches with."""
ROW_S = 0.008
"""From row to row, or one sample where samples are further apart."""
EDGE_S = 0.15
_MIN_SAMPLES = 30


@dataclass(frozen=True)
class Trajectory:
    """One episode of k joints, at full rate (s samples) and thinned out (t rows, every ``every``-th sample).

    Attributes:
        recording: where it comes from.
        every: samples from row to row.
        cutoff_hz: of the low-pass filter.
        position, velocity, acceleration: smoothed, shape (t, k).
        fast_position, fast_velocity: smoothed less, at full rate, shape (s, k).
        valid: rows far from gaps and from both ends of the episode, shape (t, k).
    """

    recording: Recording
    every: int
    cutoff_hz: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    fast_position: np.ndarray
    fast_velocity: np.ndarray
    valid: np.ndarray

    @property
    def step_s(self) -> float:
        """Of the samples."""
        return self.recording.step_s

    @property
    def joints(self) -> JointSignals:
        """As recorded."""
        assert self.recording.joints is not None
        return self.recording.joints

    @property
    def time_s(self) -> np.ndarray:
        """Of the rows, shape (t,)."""
        return self.recording.time_s[:: self.every]

    def smoothed(self, series: np.ndarray) -> np.ndarray:
        """Series at full rate, filtered as the motion was and thinned out; shapes (..., s) and (..., t)."""
        return _low_pass(series, self.cutoff_hz, self.step_s)[..., :: self.every]

    def smoothed_noise(self, noise: np.ndarray) -> np.ndarray:
        """Standard deviation of smoothed white noise; shapes (k,)."""
        return noise * self._noise_gain(0)

    def velocity_noise(self, position_noise: np.ndarray) -> np.ndarray:
        """Standard deviation of the smoothed velocity for white noise of the positions; shapes (k,)."""
        return position_noise * self._noise_gain(1)

    def acceleration_noise(self, position_noise: np.ndarray) -> np.ndarray:
        """Standard deviation of the smoothed acceleration for white noise of the positions; shapes (k,)."""
        return position_noise * self._noise_gain(2)

    def _noise_gain(self, derivative: int) -> float:
        impulse = np.zeros(2 * round(1.0 / self.step_s) + 1)
        impulse[len(impulse) // 2] = 1.0
        response = np.diff(_low_pass(impulse, self.cutoff_hz, self.step_s), derivative) / self.step_s**derivative
        return float(np.sqrt(response @ response))

    def averaged(self, series: np.ndarray) -> np.ndarray:
        """Series at full rate, averaged as second differences over rows average accelerations; shapes (..., s) and (..., t)."""
        weights = (self.every - np.abs(np.arange(1 - self.every, self.every))) / self.every**2
        width = self.every - 1
        padded = np.pad(series, [(0, 0)] * (series.ndim - 1) + [(width, width)], mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * self.every - 1, axis=-1)
        return windows[..., :: self.every, :] @ weights

    @property
    def position_noise_rad(self) -> np.ndarray:
        """As :func:`position_noise`, as if white up to half of the rate of the grid; slower joints have theirs below it; (k,)."""
        return self.by_own_samples(position_noise, self.joints.position_rad) * np.sqrt(self._own_steps)

    @property
    def encoder_step_rad(self) -> np.ndarray:
        """In which the joints' positions were reported, as :func:`encoder_step`, shape (k,)."""
        known = self.joints.encoder_step_rad
        return self.by_own_samples(encoder_step, self.joints.position_rad) if known is None else known

    def by_own_samples(self, level: Callable[[np.ndarray], np.ndarray], series: np.ndarray) -> np.ndarray:
        """A level of each column of series, shape (s, k), from samples as far apart as the joint's own; shape (k,)."""
        found = level(series)
        for j, steps in enumerate(self._own_steps):
            if steps > 1:
                found[j] = level(series[::steps, j : j + 1])[0]
        return found

    @property
    def _own_steps(self) -> np.ndarray:
        """Samples of the grid from one position of a joint to the next, shape (k,)."""
        own_s = self.joints.position_step_s
        return np.ones(len(self.joints.names), int) if own_s is None else np.round(own_s / self.step_s).astype(int)

    @property
    def inner(self) -> np.ndarray:
        """Rows far from both ends of the episode, shape (t,)."""
        edge, samples = round(EDGE_S / self.step_s), np.arange(len(self.fast_position))[:: self.every]
        return (samples >= edge) & (samples < len(self.fast_position) - edge)

    @property
    def raw_acceleration(self) -> np.ndarray:
        """Second differences of the positions as reported, over rows; shape (t, k)."""
        return self.second_differences(filled_gaps(self.joints.position_rad).T).T

    def second_differences(self, series: np.ndarray) -> np.ndarray:
        """Of series at full rate, over rows; shapes (..., s) and (..., t), per s^2."""
        rows = series[..., :: self.every]
        found = np.zeros_like(rows)
        found[..., 1:-1] = np.diff(rows, 2, axis=-1) / (self.step_s * self.every) ** 2
        return found


def trajectory(recording: Recording, *, cutoff_hz: float = CUTOFF_HZ) -> Trajectory:
    """Smooth an episode.

    Raises:
        RecordingError: it has no joints, or is too short or too slow for the filter.
    """
    joints, step_s = recording.joints, recording.step_s
    if joints is None:
        raise RecordingError(f"{recording.source}: episode {recording.name} has no joints")
    if len(recording.time_s) < _MIN_SAMPLES or recording.duration_s < 4 * EDGE_S:
        raise RecordingError(
            f"{recording.source}: episode {recording.name} has {len(recording.time_s)} samples in {recording.duration_s:.2g} s; "
            f"a study needs at least {_MIN_SAMPLES} and {4 * EDGE_S:g} s"
        )
    slowest_s = step_s if joints.position_step_s is None else float(joints.position_step_s.max())
    cutoff_hz = min(cutoff_hz, 0.2 / slowest_s)
    raw, missing = joints.position_rad, np.isnan(joints.position_rad)
    filled = filled_gaps(raw)
    smooth, fast = (_low_pass(filled.T, cutoff, step_s).T for cutoff in (cutoff_hz, min(FAST_CUTOFF_HZ, 0.3 / slowest_s)))
    every = max(1, round(ROW_S / step_s))
    velocity, acceleration = np.gradient(smooth, step_s, axis=0), np.zeros_like(smooth)
    acceleration[1:-1] = np.diff(smooth, 2, axis=0) / step_s**2
    edge = round(EDGE_S / step_s)
    valid = ~near_gaps(missing, step_s, cutoff_hz)
    valid[:edge] = valid[-edge:] = False
    return Trajectory(
        recording=recording,
        every=every,
        cutoff_hz=cutoff_hz,
        position=smooth[::every],
        velocity=velocity[::every],
        acceleration=acceleration[::every],
        fast_position=fast,
        fast_velocity=np.gradient(fast, step_s, axis=0),
        valid=valid[::every],
    )


def near_gaps(missing: np.ndarray, step_s: float, cutoff_hz: float) -> np.ndarray:
    """Samples that smoothing mixes with missing ones, shapes (s, k); a lower cutoff reaches further in proportion."""
    width = round(EDGE_S * CUTOFF_HZ / cutoff_hz / step_s)
    return signal.convolve(missing.astype(float), np.ones((min(width, len(missing)), 1)), mode="same") > 0.5


def filled_gaps(series: np.ndarray) -> np.ndarray:
    """A series (s, k) whose missing samples are interpolated; zero where everything is missing."""
    if not np.isnan(series).any():
        return series
    filled, index = series.copy(), np.arange(len(series))
    for column in filled.T:
        known = ~np.isnan(column)
        column[:] = np.interp(index, index[known], column[known]) if known.any() else 0.0
    return filled


def _low_pass(series: np.ndarray, cutoff_hz: float, step_s: float) -> np.ndarray:
    """Along the last axis, forwards and backwards."""
    sections = _sections(cutoff_hz, step_s)
    return signal.sosfiltfilt(sections, series, padlen=min(series.shape[-1] - 1, round(0.5 / step_s)))


@functools.cache
def _sections(cutoff_hz: float, step_s: float) -> np.ndarray:
    return np.asarray(signal.butter(ORDER, cutoff_hz, fs=1.0 / step_s, output="sos"))
