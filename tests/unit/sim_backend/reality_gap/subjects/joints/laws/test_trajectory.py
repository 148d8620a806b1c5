"""Recorded motions made fit for differentiation."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.measured.sensor_noise import position_noise, white_noise
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.subjects.joints.laws.trajectory import EDGE_S, filled_gaps, trajectory
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import INERTIA_KG_M2, STEP_S, drive, joints_model, recording


@pytest.fixture(scope="module")
def driven():
    return drive(joints_model(), 3.0)


def test_averaged_torques_are_what_second_differences_over_rows_need(driven):
    position, torque = driven
    path = trajectory(recording(position, torque))
    needed, given = INERTIA_KG_M2 * path.raw_acceleration, path.averaged(torque.T).T
    assert path.every == 8
    np.testing.assert_allclose(given[1:-1], needed[1:-1], atol=1e-9)
    assert np.abs(torque[:: path.every] - needed)[1:-1].max() > 1e-4  # not so without the averaging


def test_smoothing_shifts_nothing_in_time(driven):
    path = trajectory(recording(*driven))
    inner = slice(30, -30)
    np.testing.assert_allclose(path.position[inner], driven[0][:: path.every][inner], atol=5e-5)
    velocity = np.gradient(driven[0], STEP_S, axis=0)[:: path.every]
    np.testing.assert_allclose(path.velocity[inner], velocity[inner], atol=3e-3)
    acceleration = path.smoothed(driven[1].T).T / INERTIA_KG_M2
    np.testing.assert_allclose(path.acceleration[inner], acceleration[inner], atol=2e-2 * np.abs(acceleration).max())


def test_rows_near_gaps_and_ends_do_not_count(driven):
    position = driven[0].copy()
    position[1500:1520, 1] = np.nan
    path = trajectory(recording(position, driven[1]))
    far = np.abs(path.time_s - 1.51) > 0.01 + 0.5 * EDGE_S + 0.008
    inner = (path.time_s > EDGE_S + 0.008) & (path.time_s < 3.0 - EDGE_S - 0.008)
    assert path.valid[inner & far].all()
    assert path.valid[inner][:, [0, 2]].all()
    assert not path.valid[np.abs(path.time_s - 1.51) < 0.05, 1].any()
    assert not path.valid[path.time_s < EDGE_S].any()
    assert not path.valid[path.time_s > 3.0 - EDGE_S + 0.001].any()


def test_gaps_are_interpolated():
    series = np.array([[1.0, np.nan], [np.nan, np.nan], [3.0, np.nan], [np.nan, np.nan]])
    np.testing.assert_array_equal(filled_gaps(series), [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [3.0, 0.0]])
    assert np.isnan(series).sum() == 6
    whole = np.ones((3, 1))
    assert filled_gaps(whole) is whole


def test_noise_is_told_from_motion(driven):
    noise = np.array([1e-4, 3e-4, 1e-3])
    noisy = driven[0] + noise * np.random.default_rng(0).standard_normal(driven[0].shape)
    np.testing.assert_allclose(white_noise(noisy), noise, rtol=0.1)
    np.testing.assert_allclose(position_noise(noisy), noise, rtol=0.1)
    coarse = 5e-4 * np.round(driven[0] / 5e-4)
    assert position_noise(coarse).min() > 0.999 * 5e-4 / np.sqrt(12.0)


def test_noise_of_the_smoothed_acceleration_is_known(driven):
    noise = 1e-4 * np.random.default_rng(3).standard_normal(driven[0].shape)
    noisy, clean = (trajectory(recording(driven[0] + n, driven[1])) for n in (noise, 0.0))
    found = (noisy.acceleration - clean.acceleration)[30:-30].std(axis=0)
    np.testing.assert_allclose(found, clean.acceleration_noise(np.full(3, 1e-4)), rtol=0.25)
    found = (noisy.velocity - clean.velocity)[30:-30].std(axis=0)
    np.testing.assert_allclose(found, clean.velocity_noise(np.full(3, 1e-4)), rtol=0.25)
    found = (noisy.position - clean.position)[30:-30].std(axis=0)
    np.testing.assert_allclose(found, clean.smoothed_noise(np.full(3, 1e-4)), rtol=0.25)


def test_what_is_too_short_is_refused(driven):
    whole = recording(*driven)
    with pytest.raises(RecordingError, match=r"has 29 samples in 0.029 s; a study needs at least 30 and 0.6 s"):
        trajectory(recording(driven[0][:29], driven[1][:29]))
    with pytest.raises(RecordingError, match="has no joints"):
        trajectory(replace(whole, joints=None))
