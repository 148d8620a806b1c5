"""The interval of the paired difference, on made-up farms whose true difference is known."""

import functools
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from robot_farm.hidden_physics import HiddenPhysics, farm_secret
from sim_backend.effects.ranges import load_ranges
from tests.benchmarks.published_experts import HARDER, TASKS, compared, difference_interval, drawn_robot

GOALS, ROBOTS, FARMS = 200, 8, 3
STUDIES = 300
"""Made-up studies for one coverage; what is below the 1e-4 quantile for 0.95 is not chance."""


def study(rng, goal_std: float, robot_std: float) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Nominal successes (goals,), real ones (farms, goals) and who ran them.

    Each goal and each robot shifts the chance of success linearly, so that the true difference is -0.2 for all.
    """
    ease = rng.choice([-goal_std, goal_std], GOALS)
    nominal = rng.random(GOALS) < 0.75 + ease
    robots = [rng.permutation(np.arange(GOALS) % ROBOTS) for _ in range(FARMS)]
    skill = rng.choice([-robot_std, robot_std], (FARMS, ROBOTS))
    chance = np.stack([0.55 + ease + skill[farm][robots[farm]] for farm in range(FARMS)])
    return nominal.astype(float), (rng.random((FARMS, GOALS)) < chance).astype(float), robots


@functools.cache
def coverage(goal_std: float, robot_std: float) -> tuple[float, float]:
    """How often the interval holds the truth, and how often that of pairs taken for independent does."""
    rng, held, naive = np.random.default_rng(20261121), 0, 0
    for _ in range(STUDIES):
        nominal, real, robots = study(rng, goal_std, robot_std)
        difference = real - nominal
        low, high = difference_interval(difference, robots, rng, resamples=400)
        held += low < -0.2 < high
        error = 1.96 * difference.std() / np.sqrt(difference.size)
        naive += abs(difference.mean() + 0.2) < error
    return held / STUDIES, naive / STUDIES


@pytest.mark.parametrize(
    ("goal_std", "robot_std"),
    [
        (0.0, 0.0),
        pytest.param(0.2, 0.0, marks=pytest.mark.scale),
        pytest.param(0.0, 0.2, marks=pytest.mark.scale),
        (0.15, 0.15),
    ],
)
def test_the_interval_holds_the_truth_at_least_as_often_as_it_says(goal_std, robot_std):
    """`test_the_interval_holds_the_truth_at_least_as_often_as_it_says` has neither and both of what differs without scale."""
    held, _ = coverage(goal_std, robot_std)
    assert held >= binom.ppf(1e-4, STUDIES, 0.95) / STUDIES


def test_pairs_taken_for_independent_would_promise_too_much():
    _, naive = coverage(0.15, 0.15)
    assert naive < binom.ppf(1e-4, STUDIES, 0.95) / STUDIES


def test_the_interval_is_not_needlessly_wide():
    rng, widths, means = np.random.default_rng(20261122), [], []
    for _ in range(100):
        nominal, real, robots = study(rng, 0.15, 0.15)
        low, high = difference_interval(real - nominal, robots, rng, resamples=400)
        widths.append(high - low)
        means.append((real - nominal).mean())
    assert np.mean(widths) < 3**0.5 * 2 * 1.96 * np.std(means)  # single trials count thrice in the variance at worst


def test_the_same_farm_thrice_is_no_more_than_one_farm():
    nominal, real, robots = study(np.random.default_rng(5), 0.2, 0.0)
    once = difference_interval((real - nominal)[:1], robots[:1], np.random.default_rng(1), resamples=4000)
    thrice = difference_interval(np.tile((real - nominal)[:1], (3, 1)), robots[:1] * 3, np.random.default_rng(1), resamples=4000)
    assert thrice[1] - thrice[0] > 0.7 * (once[1] - once[0])  # taken for independent it would be 0.58


def test_the_summary_averages_over_the_farms():
    rng = np.random.default_rng(7)
    nominal, real, robots = study(rng, 0.1, 0.1)

    def farm(success, names):
        found = {"success": [bool(won) for won in success], "robot": [f"robot-{name}" for name in names], "between_robots": None}
        return dict.fromkeys(TASKS, found)

    farms = [farm(wins, names) for wins, names in zip(real, robots, strict=True)]
    summary = compared(farm(nominal, np.zeros(GOALS, dtype=int)), farms)["push"]
    assert summary["difference"] == pytest.approx(real.mean() - nominal.mean())
    assert summary["real"] == pytest.approx(real.mean(axis=1).tolist())
    low, high = summary["difference_interval_95"]
    assert low < summary["difference"] < high
    assert len(summary["robots"][0]) == ROBOTS


def test_a_robot_with_the_ranges_of_real_is_that_of_the_farm():
    secret = farm_secret(Path(), 7003)
    assert drawn_robot(7003, "robot-3", {}).document() == HiddenPhysics(secret, "robot-3", "real").physics.document()


@pytest.mark.parametrize("name", HARDER)
def test_harder_ranges_move_a_robot_to_the_same_place_within_them(name):
    usual, harder = drawn_robot(7003, "robot-3", {}).given, drawn_robot(7003, "robot-3", HARDER[name]).given
    assert {key for key in usual if not np.array_equal(usual[key], harder[key])} == set(HARDER[name])
    ranges = {row.key: (row.low, row.high) for row in load_ranges("real").rows}
    for key, (low, high) in HARDER[name].items():
        before, after = ranges[key]
        np.testing.assert_allclose((harder[key] - low) / (high - low), (usual[key] - before) / (after - before))
