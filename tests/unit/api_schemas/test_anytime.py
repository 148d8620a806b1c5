import math

import numpy as np
import pytest

from api_schemas.anytime import difference_sequence, is_decided, log_evidence, rate_sequence
from api_schemas.success_rate import wilson


@pytest.mark.parametrize(("successes", "trials"), [(0, 7), (7, 7), (3, 7), (32, 40), (500, 1000)])
def test_a_sequence_holds_the_rate_that_was_seen_and_is_wider_than_an_interval_for_one_look(successes, trials):
    for level in (0.80, 0.95):
        low, high = rate_sequence(successes, trials, level)
        once = wilson(successes, trials, level)
        assert low <= successes / trials <= high
        assert (low < once[0] or low == 0) and (high > once[1] or high == 1)
    mirrored = rate_sequence(trials - successes, trials, 0.95)
    assert rate_sequence(successes, trials, 0.95) == pytest.approx((1 - mirrored[1], 1 - mirrored[0]), abs=1e-9)


def test_before_the_first_trial_everything_is_possible():
    assert rate_sequence(0, 0, 0.95) == (0, 1)
    assert difference_sequence(0, 0, 0, 0.95) == (-1, 1)


def test_the_edge_of_a_sequence_is_where_mixed_wealth_is_twenty():
    """Against the definition: wealth as an integral over rates, by a rule of its own."""
    high = rate_sequence(3, 20, 0.95)[1]
    angle = (np.arange(20_000) + 0.5) * math.pi / 20_000
    rates = np.sin(angle / 2) ** 2  # uniform in the angle is the arcsine law, the beta law of 1/2 and 1/2
    wealth = np.mean((rates / high) ** 3 * ((1 - rates) / (1 - high)) ** 17)
    assert wealth == pytest.approx(20, rel=1e-3)


def test_expected_evidence_of_equal_policies_is_one():
    """What makes it a martingale: after any number of goals on which they differ its mean is 1."""
    for differing in (1, 5, 30):
        chances = [math.comb(differing, gained) / 2**differing for gained in range(differing + 1)]
        mean = sum(chance * math.exp(log_evidence(g, differing - g)) for g, chance in enumerate(chances))
        assert mean == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize(("gained", "lost", "goals"), [(15, 3, 60), (13, 4, 60), (8, 0, 8), (7, 0, 7), (2, 9, 300)])
def test_a_sequence_of_differences_excludes_none_exactly_when_it_is_decided(gained, lost, goals):
    low, high = difference_sequence(gained, lost, goals, 0.95)
    assert (low > 0 or high < 0) is is_decided(gained, lost)
    assert low < (gained - lost) / goals <= high
    assert difference_sequence(lost, gained, goals, 0.95) == pytest.approx((-high, -low), abs=1e-9)


def test_true_differences_lie_within_the_sequence_at_every_look():
    rng, outside = np.random.default_rng(240), 0
    for _ in range(30):
        draws = rng.choice([1, -1, 0], size=40, p=[0.3, 0.1, 0.6])
        counts = ((int((draws[:n] == 1).sum()), int((draws[:n] == -1).sum()), n) for n in range(8, 41, 8))
        outside += any(not low <= 0.2 <= high for low, high in (difference_sequence(*each, 0.80) for each in counts))
    assert outside <= 13  # 6 expected at most; more than 13 has a chance below 1 %
