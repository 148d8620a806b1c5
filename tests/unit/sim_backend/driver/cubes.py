"""Cubes at rest and in a grasp before the cameras, and the statistics of what is reported of them."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2, norm

from sim_backend.driver.driver import Measurement, Segment
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad

TAILS = 1e-6
"""Probability that a limit is left by chance; the limits follow from it and the number of reports."""
REST_M, REST_WXYZ = np.array([0.01, 0.02, 0.0325]), np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
UPRIGHT = np.tile([0.0, 0.9, -1.7], 3)
POSES = ("cube_position_world_m", "cube_quat_wxyz")


def grasp(position_m) -> np.ndarray:
    """Joint positions with the three tips on three faces of an upright cube, shape (9,)."""
    reach = c.CUBE_WIDTH_M / 2 + c.TIP_RADIUS_M
    tips = np.asarray(position_m) + reach * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
    joints = joint_position_rad(tips.reshape(9))
    assert (joints > c.SOFT_LIMIT_LOWER_RAD).all() and (joints < c.SOFT_LIMIT_UPPER_RAD).all()
    return joints


def segment(first, steps, n=1, joints=UPRIGHT, position=REST_M, quat=REST_WXYZ) -> Segment:
    """``n`` robots for some steps; arguments are one state, or one for each step."""

    def rows(value, width):
        return np.ascontiguousarray(np.broadcast_to(value, (n, steps, width)))

    q, none = rows(joints, 9), np.zeros((n, steps, 9))
    return Segment(first, q, none, none, none, none, none, q, none, rows(position, 3), rows(quat, 4))


def start(part: Segment) -> Measurement:
    first = {name: getattr(part, name)[:, 0] for name in Segment._fields if name != "first_step"}
    measured = {"joint_torque_nm": first["measured_torque_nm"], **first}
    return Measurement(**{name: measured[name] for name in Measurement._fields if name in measured})


def reports(values=None, *, n=1, seconds=10.0, seed=7, block=100, physics=None, shape=None, **state) -> list[TrackedPose]:
    """Everything that is reported in this time, after the report at the start."""
    physics = physics or Physics.of(n, values or {})
    tracker = Tracker(physics=physics, **({"shape": shape} if shape else {}))
    tracker.reset(start(segment(0, block, n, **state)), seed + np.arange(n))
    out = []
    for first in range(0, round(seconds * 1000), block):
        tracker.capture(segment(first, block, n, **state))
        out += tracker.deliver(first + block)
    return out


def column(found: list[TrackedPose], name: str) -> np.ndarray:
    """A field of all reports of robot 0, shape (reports, ...)."""
    return np.array([getattr(report, name)[0] for report in found])


def std_within(sample, std) -> bool:
    """Whether a sample's standard deviation is what it should be, within the limits that its size allows."""
    low, high = std * np.sqrt(chi2.ppf([TAILS / 2, 1 - TAILS / 2], len(sample) - 1) / (len(sample) - 1))
    return low < np.std(sample, ddof=1) < high


def mean_within(sample, mean, std) -> bool:
    return abs(np.mean(sample) - mean) < norm.ppf(1 - TAILS / 2) * std / np.sqrt(len(sample))


def count_within(count, n, probability) -> bool:
    return binom.ppf(TAILS / 2, n, probability) <= count <= binom.ppf(1 - TAILS / 2, n, probability)


def jumped(found: list[TrackedPose], quat=REST_WXYZ, limit_rad=0.7) -> np.ndarray:
    """Which reports have an orientation that is not the cube's."""
    true = Rotation.from_quat(np.roll(quat, -1))
    raw = Rotation.from_quat(np.roll(column(found, "raw_quat_wxyz"), -1, axis=1))
    return (true.inv() * raw).magnitude() > limit_rad
