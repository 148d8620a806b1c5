"""What a contrast says: all verdicts, from data that is made up to lead there."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_ind

from experiments.design import Contrast, Measure
from experiments.judging import (
    Difference,
    Verdict,
    detectable,
    paired_success,
    samples_to,
    student,
    times_fewer,
    verdict,
    welch,
)

GAIN = Contrast("a gain", Measure.SUCCESS, "first", "other", 0.15)
LOSS = Contrast("a loss", Measure.SUCCESS, "first", "other", 0.2, loss=True)


def runs(rates, goals=40, seed=0):
    """Outcomes of a run for each rate, on the same goals; a goal is reached by all who are good enough for it."""
    hard = np.random.default_rng(seed).permutation(goals) / goals
    return [{goal: bool(hard[goal] < rate) for goal in range(goals)} for rate in rates]


def test_a_clear_gain_over_three_seeds_is_reproduced():
    found = paired_success(runs((0.3, 0.35, 0.3)), runs((0.7, 0.75, 0.8)))
    assert found.n == 120 and found.runs == 3
    assert found.estimate == pytest.approx(0.4333, abs=0.01)
    assert verdict(GAIN, found) is Verdict.REPRODUCED


def test_a_clear_loss_is_not_reproduced():
    assert verdict(GAIN, paired_success(runs((0.7, 0.75, 0.8)), runs((0.3, 0.35, 0.3)))) is Verdict.NOT_REPRODUCED


def test_no_difference_that_is_known_well_is_not_reproduced():
    same = [{goal: goal % 2 == 0 for goal in range(2000)}]
    found = paired_success(same, same)
    assert found.low <= 0 <= found.high and found.width < GAIN.interest
    assert verdict(GAIN, found) is Verdict.NOT_REPRODUCED


def test_seeds_that_disagree_leave_it_undecided_though_all_pairs_together_would_not():
    first, other = runs((0.3, 0.3, 0.3)), runs((0.9, 0.2, 0.4))
    pooled = paired_success([dict(enumerate(v for run in first for v in run.values()))],
                            [dict(enumerate(v for run in other for v in run.values()))])  # fmt: skip
    assert pooled.low > 0
    found = paired_success(first, other)
    assert found.low < 0 < found.high
    assert verdict(GAIN, found) is Verdict.UNDECIDED


def test_few_trials_of_single_policies_are_undecided():
    found = paired_success(runs((0.5,), goals=8), runs((0.6,), goals=8))
    assert verdict(GAIN, found) is Verdict.UNDECIDED


def test_nothing_found_is_not_run():
    assert paired_success([], []) is None
    assert paired_success([{1: True}], [{2: True}]) is None
    assert verdict(GAIN, None) is Verdict.NOT_RUN


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-0.15, 0.03, Verdict.REPRODUCED),  # holds 0, is narrow, and no loss of interest is within
        (-0.18, -0.01, Verdict.REPRODUCED),
        (-0.4, -0.25, Verdict.NOT_REPRODUCED),
        (-0.4, -0.1, Verdict.UNDECIDED),
        (-0.19, 0.1, Verdict.UNDECIDED),  # holds 0 and is wider than the loss of interest
    ],
)
def test_a_claim_that_little_is_lost(low, high, expected):
    assert verdict(LOSS, Difference((low + high) / 2, low, high, 40, 1)) is expected


def test_welch_agrees_with_scipy():
    rng = np.random.default_rng(1)
    a, b = rng.normal(0, 1, 20), rng.normal(1, 3, 12)
    found, other = welch(a, b), ttest_ind(b, a, equal_var=False).confidence_interval(0.8)
    assert (found.low, found.high) == pytest.approx((other.low, other.high))
    assert welch([50, 50], [50, 50]) == Difference(0.0, 0.0, 0.0, 4, 1)


def test_student_of_a_single_value_knows_nothing():
    assert student([0.3]).width == math.inf


def evaluations(*rates):
    return [{"samples": 100 * (at + 1), "physics": "nominal", "success_rate": rate} for at, rate in enumerate(rates)]


def test_samples_to_a_rate():
    assert samples_to(evaluations(0.1, 0.8, 0.9), 0.8, 1000) == (200, True)
    assert samples_to(evaluations(0.1, 0.7), 0.8, 1000) == (1000, False)
    elsewhere = [{"samples": 5, "physics": "real", "success_rate": 1.0}]
    assert samples_to(elsewhere, 0.8, 1000) == (1000, False)


def test_savings_are_factors_and_open_where_the_other_never_arrived():
    late, early = [(1600, False), (1600, False), (800, True)], [(200, True), (200, True), (100, True)]
    found = times_fewer(late, early)
    assert (found.estimate, found.low, found.high) == (3.0, 3.0, 3.0)
    assert times_fewer(early, late).low == -math.inf
    assert verdict(Contrast("", Measure.SAMPLES_TO, "a", "b", 1.0), times_fewer(early, late)) is Verdict.UNDECIDED


def test_the_stated_power_is_what_repetitions_show():
    """Of designs with the stated difference, four of five decide."""
    rng, pairs = np.random.default_rng(3), 120
    difference = detectable(pairs)
    gained, lost = (0.3 + difference) / 2, (0.3 - difference) / 2
    decided = 0
    for _ in range(400):
        more, fewer, _rest = rng.multinomial(pairs, [gained, lost, 0.7])
        first = [{goal: more <= goal < more + fewer for goal in range(pairs)}]
        other = [{goal: goal < more for goal in range(pairs)}]
        decided += paired_success(first, other).low > 0
    assert 0.72 < decided / 400 < 0.88
