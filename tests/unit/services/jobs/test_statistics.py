import numpy as np
import pytest
from scipy.special import chndtr
from scipy.stats import binomtest

from services.jobs.statistics import noncentral_chi_square, wilson


@pytest.mark.parametrize("level", [0.80, 0.95])
@pytest.mark.parametrize("trials", [1, 2, 7, 40, 1000])
def test_wilson_is_that_of_scipy(trials, level):
    for successes in {0, 1, trials // 2, trials - 1, trials}:
        expected = binomtest(successes, trials).proportion_ci(level, method="wilson")
        assert wilson(successes, trials, level) == pytest.approx(tuple(expected), abs=1e-12)


@pytest.mark.parametrize(
    ("successes", "level", "shown"),
    [
        (0, 0.8, ("0.000", "0.039")),
        (20, 0.8, ("0.401", "0.599")),
        (30, 0.8, ("0.654", "0.827")),
        (36, 0.8, ("0.823", "0.946")),
        (40, 0.8, ("0.961", "1.000")),
        (20, 0.95, ("0.352", "0.648")),
    ],
)
def test_published_values_for_forty_trials(successes, level, shown):
    assert tuple(f"{bound:.3f}" for bound in wilson(successes, 40, level)) == shown


def test_nothing_is_known_without_trials():
    assert wilson(0, 0, 0.8) == (0.0, 1.0)


@pytest.mark.parametrize("noncentrality", [0.0, 0.1, 5.0, 100.0, 9_900.0])
@pytest.mark.parametrize("free", [1, 3, 7, 63])
def test_the_noncentral_chi_square_is_that_of_scipy(free, noncentrality):
    for x in np.array([1e-3, 0.5, 0.9, 1.0, 1.03, 1.2, 3.0]) * (free + noncentrality):
        assert noncentral_chi_square(x, free, noncentrality) == pytest.approx(chndtr(x, free, noncentrality), abs=1e-9)


def test_beyond_a_large_noncentrality_it_is_nearly_normal():
    for x in (9_800.0, 10_000.0, 10_200.0, 12_000.0):
        assert noncentral_chi_square(x, 7, 10_001.0) == pytest.approx(chndtr(x, 7, 10_001.0), abs=0.005)
    assert noncentral_chi_square(0.0, 7, 10_001.0) == noncentral_chi_square(0.0, 7, 1.0) == 0
