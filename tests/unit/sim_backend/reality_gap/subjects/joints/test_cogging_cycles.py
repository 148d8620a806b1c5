"""Lines of a torque over the position."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.cogging_cycles import strongest_line

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
