"""The few robots that both sides of a contrast share are chance, too, and an interval says which chance sets it."""

import math

import numpy as np
import pytest

from experiments.judging import Arrival, Verdict, paired_goals, paired_success, rate_interval, student, verdict
from tests.unit.experiments.test_judging import GAIN, runs, saving, success

ROBOTS = [f"robot-{number}" for number in range(4)]


def on_robots(rng, gains, rates, goals=40, seeds=1):
    """Both cells' outcomes and robots: each goal on one robot, the other cell better by that robot's gain."""
    robot = rng.integers(len(ROBOTS), size=goals)
    sides = [[rng.random(goals) < rates[robot] + gains[robot] * side for _ in range(seeds)] for side in (-0.5, 0.5)]
    reached = [[{goal: bool(each) for goal, each in enumerate(run)} for run in side] for side in sides]
    return reached, [[{goal: ROBOTS[each] for goal, each in enumerate(robot)}] * seeds] * 2


@pytest.mark.parametrize("seeds", [1, 3])
def test_robots_that_both_sides_share_are_not_counted_as_all_that_there_could_be(seeds):
    """Over all robots that could be drawn there is no difference: an interval at 80 % holds it about so often."""
    rng, held, repetitions = np.random.default_rng(5), 0, 150
    for _ in range(repetitions):
        reached, robots = on_robots(rng, 0.3 * rng.normal(size=4), rng.uniform(0.4, 0.6, size=4), seeds=seeds)
        found = paired_success(*reached, robots)
        assert found is not None and found.robots == 4
        held += found.low <= 0 <= found.high
    assert held / repetitions > 0.76


def test_one_robot_that_is_far_better_leaves_it_undecided_and_the_interval_says_what_sets_it():
    goals = range(40)
    robots = [{goal: ROBOTS[goal % 4] for goal in goals}]
    first = [dict.fromkeys(goals, False)]
    other = [{goal: goal % 4 == 0 for goal in goals}]
    alike = success(first, other)
    assert verdict(GAIN, alike) is Verdict.REPRODUCED and alike.widest == ("trials", "trials") and alike.robots == 0
    found = paired_success(first, other, (robots, robots))
    assert found is not None and verdict(GAIN, found) is Verdict.UNDECIDED
    around = student([1.0, 0.0, 0.0, 0.0])
    assert (found.low, found.high) == (around.low, around.high) and found.widest == ("robots", "robots")
    assert found.estimate == alike.estimate == 0.25


def test_a_trial_counts_for_the_robot_that_did_it_also_where_the_other_sides_met_another():
    goals = range(40)
    planned = {goal: ROBOTS[goal % 4] for goal in goals}
    moved = planned | {0: "robot-1"}
    reached = {goal: goal % 4 == 0 for goal in goals}
    found = paired_success([reached], [reached], ([planned], [moved]))
    around = student([0.0, 1 / 11, 0.0, 0.0])
    trials = success([reached], [reached])
    assert found is not None and found.high == max(around.high, trials.high) and found.low == min(around.low, trials.low)
    apart = paired_success([reached], [reached], ([planned], [dict.fromkeys(goals, "robot-9")]))
    assert apart is not None and apart.robots == 0 and apart.width == math.inf, "no robot was met by both"


def test_a_single_robot_says_nothing_of_others_and_is_named():
    found = paired_success(runs((0.2,))[:1], runs((0.9,))[:1], ([dict.fromkeys(range(40), "robot-0")],) * 2)
    assert found is not None and found.robots == 1 and found.widest == ("trials", "trials") and found.width < math.inf


def test_what_sets_an_interval_over_runs_is_named():
    found = success(runs((0.3, 0.3, 0.3)), runs((0.9, 0.2, 0.4)))
    assert found.widest == ("runs", "runs")
    assert paired_goals([1, 2, 3], [2, 4, 3]).widest == ("trials", "trials")
    assert saving([Arrival(800, 1600)] * 3, [Arrival(100, 200)] * 3).widest == ("runs", "runs")


def test_the_interval_of_a_rate_holds_what_its_robots_show():
    goals = range(40)
    robots, reached = {goal: ROBOTS[goal % 4] for goal in goals}, {goal: goal % 4 < 2 for goal in goals}
    low, high = rate_interval([reached], [robots])
    around = student([1.0, 1.0, 0.0, 0.0])
    assert (low, high) == (around.low, around.high)
    assert rate_interval([reached], [dict.fromkeys(goals, "robot-0")]) == rate_interval([reached])
