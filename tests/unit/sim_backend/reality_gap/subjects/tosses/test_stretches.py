"""Flight, rest and starting states are found in the data."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.subjects.tosses.geometry import geometry_of
from sim_backend.reality_gap.subjects.tosses.stretches import start_velocities, tosses_of
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec, tosses


@pytest.fixture(scope="module")
def geometry():
    return geometry_of(toss_spec().compile(), "thing")


def test_free_flight_shows_gravity_and_rest_the_half_width(geometry):
    found = tosses_of(geometry, tosses(toss_spec(gravity=(0.5, 0.0, -9.5)), 10, 1, noise_m=1e-4))
    flights = [flight.acceleration_m_s2 for toss in found for flight in toss.flights]
    assert np.median(flights, axis=0) == pytest.approx([0.5, 0.0, -9.5], abs=0.15)
    heights = np.concatenate([toss.rest[0][:, 2] for toss in found])
    assert len(heights) >= 5
    assert np.median(heights) == pytest.approx(0.05, abs=3e-4)


def test_a_gap_ends_a_stretch(geometry):
    recording = tosses(toss_spec(), 1, 2)[0]
    signals = recording.objects[0]
    position_m = signals.position_m.copy()
    position_m[50:60] = np.nan
    found = tosses_of(geometry, [replace(recording, objects=(replace(signals, position_m=position_m),))])
    assert [len(toss.time_s) for toss in found] == [50, 50]
    assert all(np.isfinite(toss.position_m).all() for toss in found)


def test_start_velocities_come_from_poses_in_the_right_frames():
    time_s, rate = np.arange(8) / 150.0, np.array([1.0, -2.0, 3.0])
    start, quat = np.array([0.8, 0.0, 0.6, 0.0]), np.empty((8, 4))
    for row, t in enumerate(time_s):
        quat[row] = start
        mujoco.mju_quatIntegrate(quat[row], rate, t)
    position = np.outer(time_s, [0.5, 0.0, 1.0]) - 0.5 * 9.81 * np.outer(time_s**2, [0.0, 0.0, 1.0])
    (velocity, std), (angular, angular_std) = start_velocities(time_s, position, quat)
    assert velocity == pytest.approx([0.5, 0.0, 1.0], abs=1e-9)
    assert angular == pytest.approx(rate, abs=1e-9)
    assert std < 1e-9 > angular_std


def test_a_resting_object_does_not_move(geometry):
    recording = tosses(toss_spec(), 1, 3)[0]
    signals = recording.objects[0]
    still = replace(signals, position_m=signals.position_m[[-1] * 110], quat_wxyz=signals.quat_wxyz[[-1] * 110])
    (toss,) = tosses_of(geometry, [replace(recording, objects=(still,))])
    assert not toss.moves
    assert not toss.flights
    assert len(toss.rest[0]) == 1
