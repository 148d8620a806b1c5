"""Intervals over training seeds hold their level where seeds differ, and where only trials do."""

import numpy as np
import pytest
from scipy.stats import t

from api_schemas.recipe import crossed_interval, seeds_interval, t_quantile, t_share
from api_schemas.success_rate import wilson

RUNS = 2000


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 9, 30])
def test_students_law_is_that_of_scipy(freedom):
    for value in (0.1, 1.0, 2.5, 9.0):
        assert t_share(value, freedom) == pytest.approx(t.cdf(value, freedom), abs=1e-12)
    for share in (0.9, 0.975, 0.9995):
        assert t_quantile(share, freedom) == pytest.approx(t.ppf(share, freedom), rel=1e-7)


@pytest.mark.parametrize("seeds", [2, 3, 5])
@pytest.mark.parametrize(("mean", "alike"), [(0.5, 4.0), (0.8, 20.0), (0.8, 1e6), (0.95, 40.0)])
def test_the_interval_over_seeds_holds_its_level_and_that_of_trials_alone_does_not_where_seeds_differ(seeds, mean, alike):
    """Rates of seeds follow a beta law; the larger ``alike``, the less they differ."""
    rng = np.random.default_rng(240_000 + seeds)
    rates = rng.beta(mean * alike, (1 - mean) * alike, size=(RUNS, seeds))
    successes = rng.binomial(40, rates)
    held = alone = 0
    for row in successes:
        low, high = seeds_interval([(int(each), 40) for each in row], 0.80)
        held += low <= mean <= high
        low, high = wilson(int(row.sum()), 40 * seeds, 0.80)
        alone += low <= mean <= high
    assert held / RUNS >= 0.78
    if alike == 4.0:
        assert alone / RUNS < 0.55


def test_the_interval_of_two_recipes_on_the_same_goals_holds_its_level():
    rng, seeds, goals, held = np.random.default_rng(241_000), 3, 30, 0
    for _ in range(RUNS // 4):
        hard = rng.normal(0, 1, goals)
        one, other = ((rng.normal(0, 0.7, (seeds, 1)) + rng.normal(0, 1, (seeds, goals)) > hard).tolist() for _ in range(2))
        low, high = crossed_interval(one, other, 0.80)
        held += low <= 0 <= high
    assert held / (RUNS // 4) >= 0.78


def test_seeds_that_all_ended_alike_leave_an_interval():
    low, high = seeds_interval([(20, 20)] * 3, 0.80)
    assert (low, high) == (pytest.approx(wilson(60, 60, 0.80)[0]), 1.0)
    low, high = crossed_interval([[True] * 10] * 2, [[True] * 10] * 2, 0.95)
    assert low < 0 < high
