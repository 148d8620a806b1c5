"""What is said of power before a run is what the judge does."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.judging import observed, success_rate
from experiments.power import SPREAD, Design, _trials, power


def test_a_design_seldom_finds_what_is_not_there():
    assert power(Design(3, 40, 0.1), 0.0, 0.0) <= 0.13
    assert power(Design(1, 120, 0.15), 0.0, 0.0) <= 0.15


def test_the_whole_rule_counts_also_what_a_floor_or_a_ceiling_hides():
    """A loss is told only where the first cell succeeds twice as often as the loss of interest."""
    loss = Design(4, 160, 0.2, loss=True, robots=16, first=0.85)
    assert power(loss, 0.0, 0.0) == 1.0
    assert power(replace(loss, first=0.15), 0.0, 0.0) < 0.1, "what reads as a gain by chance is not hidden"
    assert 0.3 < power(replace(loss, first=0.4), 0.0, 0.0) < 0.8, "the first cell's own chance decides"
    assert power(Design(3, 160, 0.2, first=0.02), 0.1, 0.0) == 0.0, "too few successes of both"
    assert power(Design(3, 160, 0.2, first=0.9), 0.1, 0.0) == 0.0, "too many of the first"


@pytest.mark.parametrize("design", [Design(2, 5000, 0.2), Design(2, 5000, 0.2, first=0.1), Design(2, 5000, 0.2, changing=0.5)])
@pytest.mark.parametrize("truth", [0.0, 0.15])
def test_made_up_trials_have_the_rates_that_are_said(design, truth):
    first, other = _trials(design, truth, 0.0, np.random.default_rng(1))
    shown = observed(first, other)
    assert shown.first == pytest.approx(design.first, abs=0.02)
    assert success_rate(other) - shown.first == pytest.approx(truth, abs=0.02)
    room = 2 * design.first + truth
    assert shown.changing == pytest.approx(min(design.changing, room), abs=0.02)


def test_what_trials_show_is_found_again_in_made_up_ones():
    design = Design(200, 160, 0.2, first=0.4, changing=0.4)
    shown = observed(*_trials(design, 0.1, 0.15, np.random.default_rng(1)))
    assert shown.spread == pytest.approx(0.15, abs=0.02)
    assert observed(*_trials(replace(design, runs=1), 0.1, 0.15, np.random.default_rng(1))).spread is None


def test_power_grows_with_the_gain_and_shrinks_where_trainings_differ():
    design = Design(3, 40, 0.1)
    assert power(design, 0.1, 0.0) < power(design, 0.2, 0.0)
    assert power(design, 0.2, SPREAD) < power(design, 0.2, 0.0)


def test_with_one_run_it_is_that_of_the_normal_law():
    """A difference of (1.28 + 0.84) standard errors is told in four of five repetitions."""
    error = (0.3 / 120) ** 0.5
    assert power(Design(1, 120, 0.1), 2.12 * error, 0.0) == pytest.approx(0.8, abs=0.08)


def test_three_seeds_have_less_than_the_normal_law_says():
    error = (0.3 / 120) ** 0.5
    assert power(Design(3, 40, 0.1), 2.12 * error, 0.0) < 0.72
    assert power(Design(3, 40, 0.1), 2.12 * error, SPREAD) < 0.6


@pytest.mark.parametrize("design", [Design(3, 40, 0.1), Design(1, 120, 0.15), Design(1, 40, 0.2, loss=True)])
def test_a_few_robots_that_may_differ_cost_power(design):
    on_four, truth = replace(design, robots=4), 0.0 if design.loss else 0.12
    assert power(on_four, truth, 0.0) < power(design, truth, 0.0)
    assert design.loss or power(on_four, 0.0, 0.0) <= 0.12


def test_a_loss_that_is_not_there_is_ruled_out_more_often_with_more_trials():
    assert power(Design(1, 40, 0.2, loss=True), 0.0, 0.0) > 0.7
    assert power(Design(1, 10, 0.2, loss=True), 0.0, 0.0) < power(Design(1, 40, 0.2, loss=True), 0.0, 0.0)
