"""The rank correlation is that of scipy, and its interval holds its level."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from api_schemas.correlation import rank_correlation


def test_it_is_that_of_scipy_also_with_ties():
    rng = np.random.default_rng(1)
    for _ in range(50):
        steps, rates = rng.integers(0, 6, 9).tolist(), rng.integers(0, 4, 9).tolist()
        found = rank_correlation("step", steps, rates)
        if found is not None and abs(found.estimate) < 1:
            assert found.estimate == pytest.approx(spearmanr(steps, rates).statistic, abs=1e-12)


@pytest.mark.parametrize("true", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("rungs", [5, 10, 20])
def test_the_interval_holds_its_level(rungs, true):
    """Of pairs of a normal law, whose rank correlation is 6 / π · asin(ρ / 2)."""
    rng, runs, held, wider = np.random.default_rng(2), 600, 0, 0
    rank = 6 / np.pi * np.arcsin(true / 2)
    for _ in range(runs):
        one = rng.normal(size=rungs)
        other = true * one + np.sqrt(1 - true**2) * rng.normal(size=rungs)
        found = rank_correlation("step", one.tolist(), other.tolist())
        held += found.interval_80[0] <= rank <= found.interval_80[1]
        wider += found.interval_95[0] <= rank <= found.interval_95[1]
    assert held / runs >= 0.75
    assert wider / runs >= 0.92


def test_where_nothing_can_be_told_nothing_is():
    assert rank_correlation("step", [1, 2, 3], [0.1, 0.2, 0.3]) is None
    assert rank_correlation("step", [1, 2, 3, 4], [0.5] * 4) is None
    perfect = rank_correlation("step", [1, 2, 3, 4, 5], [0.1, 0.2, 0.3, 0.4, 0.5])
    assert perfect.estimate == 1 and -1 < perfect.interval_80[0] < 1 == perfect.interval_80[1]
