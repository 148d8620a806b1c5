"""What following a rattling rotor buys where the width of its play was not chosen."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.gain import held_out_of_hits
from sim_backend.reality_gap.subjects.joints.signs.rattling import GAPS_RAD, NUMBERS, Followed, held_out
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import FOLDS

ROW_S, INERTIA = 0.008, 0.002
RAD = ROW_S**2 / INERTIA
WITHOUT, LEFT, TOUCHED_IN_FOLD = 9.0, 1.0, 4
"""Squares of each window without and with play, and how many windows of each fold have hits."""


def followed(left_by_fold):
    """One episode with six windows in each fold, of which some have hits, and what each fold's windows have left."""
    fold = np.repeat(np.arange(FOLDS), 6)
    hit = np.tile(np.arange(6) < TOUCHED_IN_FOLD, FOLDS)
    with_play = np.where(hit, np.asarray(left_by_fold)[fold], WITHOUT)
    return Followed(with_play, np.full(len(fold), WITHOUT), 0.01, fold, hit, np.zeros(0))


def tried(best, others):
    """What the fourth width leaves of each fold, and what the other widths do."""
    return [[followed(best if width == 3 else others)] for width in range(len(GAPS_RAD))]


def test_the_width_that_is_best_for_the_other_folds_is_used():
    lucky = np.where(np.arange(FOLDS) == 5, 0.0, 2.0 * LEFT)  # better in one fold alone
    errors = held_out(tried(np.full(FOLDS, LEFT), lucky), ROW_S, INERTIA)
    np.testing.assert_allclose(errors.after, TOUCHED_IN_FOLD * LEFT * RAD**2 / NUMBERS)
    np.testing.assert_allclose(errors.before, TOUCHED_IN_FOLD * WITHOUT * RAD**2 / NUMBERS)
    np.testing.assert_array_equal(errors.windows, TOUCHED_IN_FOLD)


def test_windows_without_hits_do_not_count_and_the_reduction_is_of_root_mean_squares():
    errors = held_out(tried(np.full(FOLDS, LEFT), np.full(FOLDS, 2.0)), ROW_S, INERTIA)
    found = held_out_of_hits(errors, "j", np.random.default_rng(1))
    assert found.before == pytest.approx(RAD * np.sqrt(WITHOUT / NUMBERS))
    assert found.reduction == pytest.approx(1.0 - np.sqrt(LEFT / WITHOUT))
    assert found.reduction_interval_95 == pytest.approx((found.reduction, found.reduction)), "all folds are alike"
    assert found.samples == TOUCHED_IN_FOLD * FOLDS
    assert found.noise_floor == pytest.approx(RAD * np.sqrt(0.01 / NUMBERS))
    assert "j off within 128 ms" in found.metric


def test_folds_that_differ_make_the_interval_wide():
    errors = held_out(tried(np.linspace(0.1, 6.0, FOLDS), np.full(FOLDS, 8.0)), ROW_S, INERTIA)
    found = held_out_of_hits(errors, "j", np.random.default_rng(1))
    low, high = found.reduction_interval_95
    assert low < found.reduction < high
    assert high - low > 0.1
