"""Rows that are missing are told from encoders that jump."""

import numpy as np
import pytest

from sim_backend.reality_gap.measured.sensor_noise import encoder_step
from sim_backend.reality_gap.subjects.joints.signs.checks import jump_in
from sim_backend.reality_gap.subjects.joints.signs.lost_rows import lost_rows
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import drive, joints_model

AT = 2500


@pytest.fixture(scope="module")
def position():
    read, _ = drive(joints_model(), 4.0)
    return read + 5e-5 * np.random.default_rng(0).standard_normal(read.shape)


def found(position):
    return lost_rows(position, encoder_step(position))


@pytest.mark.parametrize(("first", "lost"), [(AT, 30), (AT, 4), (1200, 1)])  # where two joints are too slow to be seen to jump
def test_rows_that_are_missing_are_found_where_they_were(position, first, lost):
    assert found(position) == []
    assert found(np.delete(position, slice(first, first + lost), axis=0)) == [first]


def test_all_places_are_found(position):
    several = position
    for first in (3000, 2000, 1000):
        several = np.delete(several, slice(first, first + 20), axis=0)
    assert found(several) == [1000, 1980, 2960]


@pytest.mark.parametrize(("bits", "most"), [(12, 10), (14, 5), (17, 0)])
def test_rows_that_are_missing_are_no_jump_of_a_coarse_encoder(bits, most):
    time_s, step_rad = np.arange(0.0, 20.0, 1e-3), 2.0 * np.pi / 2**bits
    whole = np.stack([1.0 * np.sin(1.5 * time_s), 0.3 * np.sin(2.3 * time_s + 1.0)], axis=1)
    blamed = 0
    for first in range(1000, 19_000, 400):
        read = step_rad * np.round(np.delete(whole, slice(first, first + 40), axis=0) / step_rad)
        jumps = [jump_in(column, step) for column, step in zip(read.T, encoder_step(read), strict=True)]
        blamed += any(jump is not None for jump in jumps) and found(read) == []
    assert blamed <= most, "of 45 places, where the other joint moves by few steps"


def test_a_joint_that_turns_round_a_little_before_and_after_tells_of_missing_rows_too():
    time_s = np.arange(-1.0, 1.0, 4e-3)
    whole = np.stack([0.4 * np.sin(2.0 * time_s), 2.55 * time_s**3 - 0.04 * time_s], axis=1)
    read = np.delete(1e-4 * np.round(whole / 1e-4), slice(245, 255), axis=0)
    jumps = [jump_in(column, step) for column, step in zip(read.T, encoder_step(read), strict=True)]
    assert [jump is not None for jump in jumps] == [True, False] and found(read) == [245]


def test_encoders_that_jump_are_no_missing_rows(position):
    one, each_at_its_time, two_of_three = position.copy(), position.copy(), position.copy()
    one[AT:, 1] += 0.02
    each_at_its_time[AT:, 1] += 0.02
    each_at_its_time[1500:, 2] += 0.02
    two_of_three[AT:, :2] += 0.02  # while the third moves on as if nothing was
    for jumped in (one, each_at_its_time, two_of_three):
        assert found(jumped) == []


def test_recordings_that_were_joined_are_torn_where_they_were(position):
    joined = np.concatenate([position[:AT], position[500:]])
    assert found(joined) == [AT]
