"""Lines of a torque over the position."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.signs.cogging_cycles import seen_cogging, strongest_line, with_cycles

MOST_HZ = 6.0


@pytest.fixture(scope="module")
def motion():
    """Slow and fast sines of 40 s, every 20 ms: position and velocity."""
    time_s = np.arange(0.0, 40.0, 0.02)
    parts = [(0.7, 0.11), (0.4, 0.37), (0.1, 1.3)]
    position = sum(size * np.sin(2 * np.pi * hz * time_s) for size, hz in parts)
    return position, np.gradient(position, 0.02)


def noise(series, sigma):
    return sigma * np.random.default_rng(0).standard_normal(len(series))


@pytest.mark.parametrize("turn", [24, 87])
def test_a_line_is_found_beneath_friction_gravity_and_noise(motion, turn):
    position, velocity = motion
    others = 0.2 * np.sign(velocity) + 0.3 * velocity + 0.5 * np.sin(position)
    left = 0.05 * np.sin(turn * position + 1.0) + others + noise(position, 0.02)
    assert strongest_line(position, velocity, left, MOST_HZ) == turn


def test_no_line_is_seen_in_noise_nor_in_slow_functions_of_the_position(motion):
    position, velocity = motion
    assert strongest_line(position, velocity, noise(position, 0.02), MOST_HZ) is None
    assert strongest_line(position, velocity, np.sin(position) + 0.3 * position**2 + noise(position, 0.02), MOST_HZ) is None


def test_a_joint_that_hardly_moves_shows_none(motion):
    position, velocity = (0.001 * series for series in motion)
    assert strongest_line(position, velocity, noise(position, 0.02), MOST_HZ) is None


def test_amplitude_and_phase_are_read_off_where_a_joint_is_slow(motion):
    position, velocity = motion
    left = -0.05 * np.sin(87 * position - 2.0) + 0.2 * np.sign(velocity) + noise(position, 0.01)
    left[np.abs(velocity) * 87 / (2.0 * np.pi) > MOST_HZ] *= 0.1  # cycles that are passed quickly are smoothed away
    two = np.stack([position, position], axis=1)
    path = SimpleNamespace(position=two, velocity=np.stack([velocity, velocity], axis=1))
    errors = np.stack([noise(position, 0.01), left], axis=1)
    episode = SimpleNamespace(path=path, valid_mechanics=np.ones_like(two, bool), torque_error=lambda _: errors)
    ((joint, (amplitude_nm, phase_rad)),) = seen_cogging(with_cycles(JointState(2), [episode]), [episode]).items()
    assert joint == 1
    assert amplitude_nm == pytest.approx(0.05, rel=0.1)
    assert phase_rad == pytest.approx(-2.0, abs=0.1)
    assert seen_cogging(JointState(2), [episode]) == {}
