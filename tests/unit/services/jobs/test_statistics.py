import numpy as np
import pytest
from scipy.special import chndtr

from services.jobs.statistics import noncentral_chi_square


@pytest.mark.parametrize("noncentrality", [0.0, 0.1, 5.0, 100.0, 9_900.0])
@pytest.mark.parametrize("free", [1, 3, 7, 63])
def test_the_noncentral_chi_square_is_that_of_scipy(free, noncentrality):
    for x in np.array([1e-3, 0.5, 0.9, 1.0, 1.03, 1.2, 3.0]) * (free + noncentrality):
        assert noncentral_chi_square(x, free, noncentrality) == pytest.approx(chndtr(x, free, noncentrality), abs=1e-9)


def test_beyond_a_large_noncentrality_it_is_nearly_normal():
    for x in (9_800.0, 10_000.0, 10_200.0, 12_000.0):
        assert noncentral_chi_square(x, 7, 10_001.0) == pytest.approx(chndtr(x, 7, 10_001.0), abs=0.005)
    assert noncentral_chi_square(0.0, 7, 10_001.0) == noncentral_chi_square(0.0, 7, 1.0) == 0
