"""Samples on a grid of equal steps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim_backend.reality_gap.measured.foreign.time_grid import (
    Grid,
    grid_over,
    held,
    interpolated,
    jumps,
    on_the_turn_of,
    unwrapped,
)


def test_the_grid_has_the_median_step_and_is_not_led_astray_by_rounding():
    grid = grid_over(np.array([0.0, 0.1, 0.2, 0.2, 0.9, 1.0]))
    assert (grid.start_s, grid.count) == (0.0, 11)
    assert abs(grid.step_s - 0.1) < 1e-12
    rounded = np.round(np.arange(1000) / 148.0, 3)
    assert abs(grid_over(rounded).step_s * 148.0 - 1.0) < 1e-3


def test_gaps_of_two_and_a_half_steps_are_bridged_and_no_more():
    grid = Grid(0.0, 1.0, 12)
    time = np.array([0.0, 1.0, 3.0, 5.5, 8.1, 9.0, 10.0])
    values = interpolated(grid, time, 2.0 * time)
    assert np.flatnonzero(np.isnan(values)).tolist() == [6, 7, 8, 11]
    known = ~np.isnan(values)
    np.testing.assert_allclose(values[known], 2.0 * grid.time_s[known])


def test_commands_hold_and_what_changes_within_a_step_is_its_mean():
    grid = Grid(0.0, 1.0, 5)
    np.testing.assert_allclose(
        held(grid, np.array([0.0, 1.25, 2.0, 3.0, 4.0]), np.array([4.0, 8.0, 0.0, 1.0, 2.0])), [4, 7, 0, 1, 2]
    )
    np.testing.assert_array_equal(held(grid, np.array([0.0, 2.0, 4.0]), np.array([3.0, 5.0, 7.0])), [3, 3, 5, 5, 7])
    assert np.flatnonzero(np.isnan(held(grid, np.array([0.0, 3.0, 4.0]), np.ones(3)))).tolist() == []
    assert np.flatnonzero(np.isnan(held(Grid(0.0, 1.0, 9), np.array([0.0, 1.0, 2.0, 6.0, 7.0, 8.0]), np.ones(6)))).tolist() == [
        3,
        4,
        5,
    ]


@given(st.lists(st.floats(-50.0, 50.0), min_size=2, max_size=60), st.floats(1e-4, 10.0), st.floats(-1e3, 1e3))
def test_samples_on_the_grid_stay_as_they_are(values, step_s, start_s):
    samples = np.array(values)
    time = start_s + step_s * np.arange(len(samples))
    grid = grid_over(time)
    assert grid.count == len(samples)
    np.testing.assert_array_equal(interpolated(grid, time, samples), samples)
    np.testing.assert_allclose(held(grid, time, samples), samples, atol=1e-9)


@given(st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=60), st.lists(st.integers(0, 59), max_size=5))
def test_unwrapping_brings_back_what_was_wrapped(steps, missing):
    angle = np.cumsum(steps)
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    back = unwrapped(wrapped)
    np.testing.assert_allclose(back - back[0], angle - angle[0], atol=1e-9)
    np.testing.assert_allclose(on_the_turn_of(wrapped, angle), angle, atol=1e-9)
    wrapped[[index for index in missing if index < len(wrapped)]] = np.nan
    assert (np.isnan(unwrapped(wrapped)) == np.isnan(wrapped)).all()


def test_only_jumps_between_neighbours_are_a_sign_of_wrapping():
    time = np.arange(10) * 0.01
    angle = np.linspace(0.0, 1.0, 10)
    assert not jumps(time, angle)
    assert jumps(time, np.where(time > 0.05, angle - 2.0 * np.pi, angle))
    assert not jumps(np.where(time > 0.05, time + 1.0, time), np.where(time > 0.05, angle - 2.0 * np.pi, angle))
