"""Which joints accelerate far more than for the noise that their controller feeds back."""

import numpy as np

from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import LIVELY, is_lively

INERTIA, TORQUE_NOISE_NM, HZ = 0.01, 0.02, 2.0


def swinging(amplitude_rad):
    """Joints that swing by amplitudes (k,), with white noise in what their motors are sent; the path and that torque (k, s)."""
    time_s = 1e-3 * np.arange(8000)
    position = np.sin(2.0 * np.pi * HZ * time_s)[:, None] * amplitude_rad
    needed = -INERTIA * (2.0 * np.pi * HZ) ** 2 * position
    torque = needed + TORQUE_NOISE_NM * np.random.default_rng(5).standard_normal(position.shape)
    joints = JointSignals(tuple("abc"), position, np.gradient(position, 1e-3, axis=0), torque, torque)
    return trajectory(Recording("swing", "swing", 1e-3, time_s, joints)), torque.T


def test_a_joint_is_lively_where_it_accelerates_far_beyond_what_noise_makes():
    path, torque = swinging(np.array([1.0, 1.0, 1.0]))
    made_by_noise = path.smoothed_noise(np.full(3, TORQUE_NOISE_NM))[0] / INERTIA
    edge_rad = LIVELY * made_by_noise / ((2.0 * np.pi * HZ) ** 2 / np.sqrt(2.0))
    path, torque = swinging(edge_rad * np.array([0.0, 0.8, 1.25]))
    np.testing.assert_array_equal(is_lively(path, torque, np.full(3, INERTIA)), [False, False, True])
