"""What a contrast says: all verdicts, from data that is made up to lead there."""

import math

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import ttest_1samp

from experiments.design import Contrast, Measure
from experiments.judging import (
    Arrival,
    Difference,
    Verdict,
    arrival,
    hidden_effect,
    paired_goals,
    paired_success,
    rate_interval,
    student,
    times_fewer,
    verdict,
)

GAIN = Contrast("a gain", Measure.SUCCESS, "first", "other", 0.15)
LOSS = Contrast("a loss", Measure.SUCCESS, "first", "other", 0.2, loss=True)
GOALS = Contrast("goals", Measure.GOALS, "first", "other", 5.0)
SAMPLES = Contrast("samples", Measure.SAMPLES_TO, "first", "other", 1.0)


def runs(rates, goals=40, seed=0):
    """Outcomes of a run for each rate, on the same goals; a goal is reached by all who are good enough for it."""
    hard = np.random.default_rng(seed).permutation(goals) / goals
    return [{goal: bool(hard[goal] < rate) for goal in range(goals)} for rate in rates]


def success(first, other) -> Difference:
    found = paired_success(first, other)
    assert found is not None
    return found


def saving(first, other) -> Difference:
    found = times_fewer(first, other)
    assert found is not None
    return found


def test_a_clear_gain_over_three_seeds_is_reproduced():
    found = success(runs((0.3, 0.35, 0.3)), runs((0.7, 0.75, 0.8)))
    assert found.n == 120 and found.runs == 3
    assert found.estimate == pytest.approx(0.4333, abs=0.01)
    assert verdict(GAIN, found) is Verdict.REPRODUCED


def test_a_clear_loss_is_not_reproduced():
    assert verdict(GAIN, success(runs((0.7, 0.75, 0.8)), runs((0.3, 0.35, 0.3)))) is Verdict.NOT_REPRODUCED


def test_no_difference_that_is_known_well_is_not_reproduced():
    same = [{goal: goal % 2 == 0 for goal in range(2000)}]
    found = success(same, same)
    assert found.low <= 0 <= found.high and found.width < GAIN.interest
    assert verdict(GAIN, found) is Verdict.NOT_REPRODUCED


def test_seeds_that_disagree_leave_it_undecided_though_all_pairs_together_would_not():
    first, other = runs((0.3, 0.3, 0.3)), runs((0.9, 0.2, 0.4))
    pooled = success([dict(enumerate(v for run in first for v in run.values()))],
                            [dict(enumerate(v for run in other for v in run.values()))])  # fmt: skip
    assert pooled.low > 0
    found = success(first, other)
    assert found.low < 0 < found.high
    assert verdict(GAIN, found) is Verdict.UNDECIDED


def test_few_trials_of_single_policies_are_undecided():
    found = success(runs((0.5,), goals=8), runs((0.6,), goals=8))
    assert verdict(GAIN, found) is Verdict.UNDECIDED


def test_nothing_found_is_not_run():
    assert paired_success([], []) is None
    assert paired_success([{1: True}], [{2: True}]) is None
    assert verdict(GAIN, None) is Verdict.NOT_RUN


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.01, 0.10, Verdict.REPRODUCED),  # smaller than of interest, but there
        (-0.12, 0.14, Verdict.NOT_REPRODUCED),  # wide, and yet no gain of interest is within
        (-0.05, 0.16, Verdict.UNDECIDED),  # holds 0 and a gain of interest
        (-0.30, -0.10, Verdict.NOT_REPRODUCED),
    ],
)
def test_a_gain_is_judged_by_the_effect_of_interest_not_by_the_width(low, high, expected):
    assert verdict(GAIN, Difference((low + high) / 2, low, high, 120, 3)) is expected


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-0.15, 0.03, Verdict.REPRODUCED),
        (-0.18, -0.01, Verdict.REPRODUCED),
        (-0.19, 0.1, Verdict.REPRODUCED),  # wider than the loss of interest, which is not within
        (-0.4, -0.25, Verdict.NOT_REPRODUCED),
        (-0.4, -0.1, Verdict.UNDECIDED),
    ],
)
def test_a_claim_that_little_is_lost(low, high, expected):
    assert verdict(LOSS, Difference((low + high) / 2, low, high, 40, 1)) is expected


def test_questions_of_ours_are_found_or_not_and_reproduce_nothing():
    ours = Contrast("ours", Measure.SUCCESS, "first", "other", 0.15, ours=True)
    assert verdict(ours, Difference(0.3, 0.2, 0.4, 40, 1)) is Verdict.FOUND
    assert verdict(ours, Difference(0.0, -0.1, 0.1, 40, 1)) is Verdict.NOT_FOUND
    assert verdict(ours, Difference(0.1, -0.1, 0.3, 40, 1)) is Verdict.UNDECIDED
    assert verdict(ours, None) is Verdict.NOT_RUN


def test_nothing_reached_by_either_tells_nothing():
    none = runs((0.0, 0.0, 0.0))
    found = success(none, none)
    hidden = hidden_effect(GAIN, found, 0.0, 0.0)
    assert hidden == "too few successes to tell"
    assert verdict(GAIN, found, hidden) is Verdict.UNDECIDED


@pytest.mark.parametrize(
    ("contrast", "first", "other", "most", "low", "high", "expected"),
    [
        (GAIN, 0.14, 0.14, 1.0, -0.05, 0.05, "too few successes to tell"),
        (GAIN, 0.14, 0.4, 1.0, 0.1, 0.4, ""),
        (GAIN, 0.9, 0.95, 1.0, -0.02, 0.1, "too many successes to tell"),
        (GAIN, 0.9, 0.3, 1.0, -0.7, -0.5, ""),  # no ceiling makes a loss
        (GAIN, 0.8, 0.8, 1.0, -0.1, 0.1, ""),
        (LOSS, 0.15, 0.05, 1.0, -0.17, -0.04, "too few successes to tell"),
        (LOSS, 0.15, 0.6, 1.0, 0.3, 0.6, ""),  # no floor makes a gain
        (LOSS, 0.4, 0.3, 1.0, -0.2, 0.0, ""),
        (GOALS, 50, 50, 50, -0.1, 0.1, "too many goals to tell"),
        (GOALS, 47, 50, 50, 1.0, 5.0, ""),
        (GOALS, 1, 3, 50, 0.5, 3.0, "too few goals to tell"),
    ],
)
def test_floors_and_ceilings_hide_effects(contrast, first, other, most, low, high, expected):
    assert hidden_effect(contrast, Difference((low + high) / 2, low, high, 40, 1), first, other, most) == expected


def made_up_runs(rng, goals=40, seeds=3):
    """Two cells that are equally good on average, each at home with other goals, the same goals in every run."""
    hard, taste = 1.5 * rng.normal(size=goals), 2.5 * rng.normal(size=goals)
    return [[dict(enumerate(rng.random(goals) < expit(0.5 + hard + side * taste / 2))) for _ in range(seeds)] for side in (-1, 1)]


def test_goals_that_all_runs_share_are_not_counted_as_independent():
    """Over all goals that could be drawn there is no difference: an interval at 80 % holds it about so often."""
    rng, held, repetitions = np.random.default_rng(4), 0, 150
    for _ in range(repetitions):
        found = success(*made_up_runs(rng))
        held += found.low <= 0 <= found.high
    assert held / repetitions > 0.76


def test_the_interval_of_a_rate_holds_what_its_runs_show():
    apart = runs((0.8, 0.9, 0.95))
    low, high = rate_interval(apart)
    around = student([0.8, 0.9, 0.95])
    assert low == pytest.approx(around.low, abs=0.01) and high == pytest.approx(around.high, abs=0.01)
    assert rate_interval(runs((1.0, 1.0)))[1] == 1.0
    single_low, single_high = rate_interval(apart[:1])
    assert 0.7 < single_low < 0.8 < single_high < 0.9


def test_goals_are_compared_trial_by_trial():
    rng = np.random.default_rng(1)
    before = rng.integers(0, 30, 20)
    after = before + rng.integers(3, 8, 20)
    found = paired_goals(before.tolist(), after.tolist())
    expected = ttest_1samp(after - before, 0).confidence_interval(0.8)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert found.low > 0 and found.n == 20 and found.runs == 1


def test_differences_that_are_all_alike_are_not_known_without_any_doubt():
    found = paired_goals([3] * 20, [5] * 20)
    assert found.estimate == 2.0 and 1.0 < found.low < 2.0 < found.high < 3.0


def test_student_of_a_single_value_knows_nothing():
    assert student([0.3]).width == math.inf


def evaluations(*rates, first=100):
    return [{"samples": first + 100 * at, "physics": "nominal", "success_rate": rate} for at, rate in enumerate(rates)]


def test_arrival_lies_between_two_evaluations():
    assert arrival(evaluations(0.1, 0.8, 0.9), 0.8, 1000) == Arrival(100, 200)
    assert arrival(evaluations(0.9), 0.8, 1000) == Arrival(0, 100)
    assert arrival(evaluations(0.1, 0.7), 0.8, 1000) == Arrival(1000, None)
    elsewhere = [{"samples": 5, "physics": "real", "success_rate": 1.0}]
    assert arrival(elsewhere, 0.8, 1000) == Arrival(1000, None)


def test_demonstrated_samples_count_also_for_a_clone_that_is_there_at_once():
    assert arrival(evaluations(0.9, 0.9, first=0), 0.8, 1000, before=75) == Arrival(75, 75)
    assert arrival(evaluations(0.1, 0.9, first=0), 0.8, 1000, before=75) == Arrival(75, 175)
    assert arrival(evaluations(0.1, first=0), 0.8, 1000, before=75).samples == 1075


def test_savings_are_as_wide_as_the_grid_of_evaluations():
    found = saving([Arrival(800, 1600)] * 3, [Arrival(100, 200)] * 3)
    assert (found.estimate, found.low, found.high) == (3.0, 2.0, 4.0)


def test_a_first_run_that_never_arrived_opens_the_upper_bound():
    found = saving([Arrival(1600, None)] * 3, [Arrival(100, 100)] * 3)
    assert (found.estimate, found.low, found.high) == (4.0, 4.0, math.inf)
    assert verdict(SAMPLES, found) is Verdict.REPRODUCED


def test_another_run_that_never_arrived_opens_the_lower_bound():
    found = saving([Arrival(100, 200)] * 3, [Arrival(100, 200), Arrival(100, 200), Arrival(1600, None)])
    assert found.low == -math.inf and found.high < math.inf
    assert verdict(SAMPLES, found) is Verdict.UNDECIDED
    neither = saving([Arrival(1600, None)] * 3, [Arrival(1600, None)] * 3)
    assert (neither.low, neither.high) == (-math.inf, math.inf)


def test_an_arrival_before_the_first_evaluation_may_have_been_at_any_time():
    assert saving([Arrival(0, 100)] * 3, [Arrival(50, 50)] * 3).low == -math.inf
    assert saving([Arrival(100, 200)] * 3, [Arrival(0, 100)] * 3).high == math.inf
