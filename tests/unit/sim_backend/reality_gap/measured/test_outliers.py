"""Glitches are told from motion, noise, steps of encoders, and pulses that are meant."""

import numpy as np
import pytest

from sim_backend.reality_gap.measured.outliers import position_outliers, torque_outliers

TIME_S = np.arange(0.0, 8.0, 0.002)
RNG = np.random.default_rng(0)
SWING = np.sin(2 * np.pi * 1.3 * TIME_S)
NOISE = 5e-5 * RNG.standard_normal(len(TIME_S))
MOTIONS = {
    "a swing": SWING + NOISE,
    "coarse steps": 5e-3 * np.round(SWING / 5e-3),
    "rest": NOISE,
    "rest between two steps of the encoder": 1e-3 * (RNG.random(len(TIME_S)) < 0.02),
    "bounces": np.abs(SWING) + NOISE,
    "a jump that stays": SWING + NOISE + 0.1 * (TIME_S > 4.0),
    "few samples for each turn": np.sin(2 * np.pi * 0.19 * np.arange(len(TIME_S))) + NOISE,
    "heavy tails": SWING + 5e-5 * RNG.standard_t(4, len(TIME_S)),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_what_joints_do_is_no_outlier(name):
    assert not position_outliers(MOTIONS[name]).any()


@pytest.mark.parametrize("size_rad", [0.5, -0.1])
def test_one_or_two_samples_far_off_are_found_and_nothing_else(size_rad):
    position = MOTIONS["a swing"].copy()
    position[[1000, 2000, 2001, 3500]] += size_rad
    assert np.flatnonzero(position_outliers(position)).tolist() == [1000, 2000, 2001, 3500]


def test_samples_that_are_missing_stay_so():
    position = MOTIONS["a swing"].copy()
    position[::2] = np.nan
    position[1001] += 0.5
    assert np.flatnonzero(position_outliers(position)).tolist() == [1001]
    assert not position_outliers(np.full(20, np.nan)).any()


def test_a_torque_that_no_motor_gives_is_found_but_no_pulse():
    torque = 3.0 * SWING + 0.005 * RNG.standard_normal(len(TIME_S))
    torque[500] = 1e4
    assert np.flatnonzero(torque_outliers(torque)).tolist() == [500]
    torque[500] = 12.0
    assert not torque_outliers(torque).any()
    assert not torque_outliers(np.zeros(100)).any()
