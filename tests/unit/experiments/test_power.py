"""What is said of power before a run is what the judge does."""

from dataclasses import replace

import pytest

from experiments.power import SPREAD, Design, power


def test_a_design_seldom_finds_what_is_not_there():
    assert power(Design(3, 40, 0.1), 0.0, 0.0) <= 0.13
    assert power(Design(1, 120, 0.15), 0.0, 0.0) <= 0.15


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
