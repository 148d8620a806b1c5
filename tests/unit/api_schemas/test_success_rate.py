import pytest
from scipy.stats import binomtest

from api_schemas.success_rate import wilson


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
