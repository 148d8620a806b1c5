"""Recordings: aligned arrays of one episode each, whatever they were read from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sim_backend.reality_gap.feedback import Feedback


class RecordingError(ValueError):
    """Data that cannot be used; the message names file, column, row and reason, and says what to do."""


@dataclass(frozen=True)
class Outlier:
    """A sample that was left out since it lies far from those before and after: channel, joint, and when, s from the begin."""

    channel: str
    joint: str
    time_s: float


@dataclass(frozen=True)
class JointSignals:
    """What was measured at k joints over s samples; shapes (s, k), NaN where a sample is missing.

    Attributes:
        names: of the joints, in the order of the columns.
        position_rad: as reported, unwrapped; rad, or m for a slide joint (so, too, everywhere below).
        velocity_rad_s: as reported, None without such a channel.
        commanded_torque_nm: what was sent to the motor for the time from this sample to the next, None if unknown.
        measured_torque_nm: what the motor reports, from its current or from a sensor, None without such a channel.
        desired_torque_nm: torque part of what a stated controller was asked for, None without one.
        position_target_rad: position part of it, NaN for none.
        temperature_rise_k: of the motors, above ambient, None without such a channel.
        position_step_s: from one position to the next as they were reported, of each joint, where some are slower than the grid
            and were bridged by straight lines, shape (k,); None where none is.
        encoder_step_rad: the step in which positions were reported before they were put on equal steps of time, 0 for none,
            shape (k,); None where the samples are as they were reported.
        outliers: samples of positions and torques that were left out.
        feedback: what turned position targets into torque, of joints of which it is known; None where it is of none.
        not_recorded: joints without any torque of their own: commanded is what ``feedback`` makes of what they reported.
        unlike_law: joints whose recorded torque is not what their stated controller makes, with the share of it that differs.
        torn_s: when positions of several joints jump at once, as where rows are missing.
    """

    names: tuple[str, ...]
    position_rad: np.ndarray
    velocity_rad_s: np.ndarray | None = None
    commanded_torque_nm: np.ndarray | None = None
    measured_torque_nm: np.ndarray | None = None
    desired_torque_nm: np.ndarray | None = None
    position_target_rad: np.ndarray | None = None
    temperature_rise_k: np.ndarray | None = None
    position_step_s: np.ndarray | None = None
    encoder_step_rad: np.ndarray | None = None
    outliers: tuple[Outlier, ...] = ()
    feedback: Feedback | None = None
    not_recorded: tuple[str, ...] = ()
    unlike_law: Mapping[str, float] = field(default_factory=dict)
    torn_s: tuple[float, ...] = ()


@dataclass(frozen=True)
class ObjectSignals:
    """Poses of one object, each with the time at which it was seen (a tracker may be slower and later than the joints).

    Attributes:
        name: of the object.
        body: of the model's body that it is.
        time_s: when a pose was valid, shape (m,), increasing.
        position_m: in the world's frame, shape (m, 3).
        quat_wxyz: shape (m, 4), normalised.
        delivery_s: when it was known, shape (m,); None if it was at once.
        confidence: of the tracker, 0 to 1, shape (m,); None without one.
        linear_velocity_m_s: in the world's frame, shape (m, 3), or None.
        angular_velocity_rad_s: in the body's frame, shape (m, 3), or None.
    """

    name: str
    body: str
    time_s: np.ndarray
    position_m: np.ndarray
    quat_wxyz: np.ndarray
    delivery_s: np.ndarray | None = None
    confidence: np.ndarray | None = None
    linear_velocity_m_s: np.ndarray | None = None
    angular_velocity_rad_s: np.ndarray | None = None


@dataclass(frozen=True)
class Recording:
    """One episode on a grid of equal steps.

    Attributes:
        name: of the episode, unique in a study.
        source: file that it was read from.
        step_s: of the grid, s.
        time_s: shape (s,); gaps in the data are samples of NaN.
        joints: None without joints.
        objects: none, one or more.
        signals: other channels by name, shape (s,), such as ``supply_v``.
        regime: what the episodes were recorded under (an excitation, a payload), for splits.
    """

    name: str
    source: str
    step_s: float
    time_s: np.ndarray
    joints: JointSignals | None = None
    objects: tuple[ObjectSignals, ...] = ()
    signals: Mapping[str, np.ndarray] = field(default_factory=dict)
    regime: str = ""

    @property
    def duration_s(self) -> float:
        """From the first sample to the end of the last."""
        return len(self.time_s) * self.step_s
