"""Samples that a logger wrote several times are told from motions that are slow, coarse or at rest."""

import numpy as np
import pytest

from sim_backend.reality_gap.measured.repeated_rows import rows_between_samples, without_repeats

TIME_S = np.arange(0.0, 8.0, 0.001)
RNG = np.random.default_rng(0)
SWING = 0.4 * np.sin(2 * np.pi * 0.8 * TIME_S) + 1e-4 * RNG.standard_normal(len(TIME_S))
COARSE = 1e-3 * np.round(SWING / 1e-3)


def held(values, every):
    """As a logger writes a sensor that is slower by so many rows, whole or not."""
    return values[(np.floor(np.arange(len(values)) / every) * every).astype(int)]


@pytest.mark.parametrize(("values", "every"), [(SWING, 2), (SWING, 4), (SWING, 10), (COARSE, 10)])
def test_of_repeated_samples_one_stays(values, every):
    found = without_repeats(held(values, every))
    assert rows_between_samples(held(values, every)) == every
    kept = np.flatnonzero(np.isfinite(found))
    assert (kept % every == 0).mean() > 0.99 and len(kept) == pytest.approx(len(values) / every, rel=0.02)
    np.testing.assert_array_equal(found[kept], held(values, every)[kept])


def test_clocks_that_drift_past_each_other_repeat_four_or_five_rows():
    found = without_repeats(held(SWING, 4.5))
    assert len(np.flatnonzero(np.isfinite(found))) == pytest.approx(len(SWING) / 4.5, rel=0.05)


SLOW = 0.05 * np.sin(2 * np.pi * 0.1 * TIME_S)
OTHERS = {
    "every row is a sample": SWING,
    "coarse steps": COARSE,
    "slow coarse steps": 1e-3 * np.round(SLOW / 1e-3),
    "steps of an encoder that were rounded once more": np.round(1.53e-3 * np.round(10.0 * SLOW / 1.53e-3), 3),
    "a reading that stands still now and then": np.where((np.arange(len(TIME_S)) // 7) % 9 == 0, held(SWING, 7), SWING),
    "rest": np.zeros(len(TIME_S)),
    "rest between two steps of the encoder": 1e-3 * (RNG.random(len(TIME_S)) < 0.02),
    "few rows": held(SWING, 4)[:60],
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_joints_do_is_no_repeat(name):
    assert rows_between_samples(OTHERS[name]) == 1
    np.testing.assert_array_equal(without_repeats(OTHERS[name]), OTHERS[name])


def test_of_a_joint_that_rests_the_samples_stay_and_what_is_missing_stays_missing():
    values = held(SWING, 4)
    values[4000:6000] = values[4000]
    values[7000:7100] = np.nan
    found = without_repeats(values)
    assert np.isfinite(found[4000:6000]).sum() == 500
    assert np.isnan(found[7000:7100]).all()
