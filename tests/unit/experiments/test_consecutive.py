"""Goals in a row end with a drop, with time, or when all are reached."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.consecutive import End, Judge, summary, try_many_goals
from experiments.design import ManyGoals
from sim_backend.layouts import layout_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import Goal, draw_trial

NO, YES = np.array([False]), np.array([True])
RESTS, UP = np.array([0.0]), np.array([0.05])


def come_down(judge, heights_m, period_s=0.02):
    """Heights above rest, one in each control period."""
    for count, height_m in enumerate(heights_m):
        judge.see(NO, np.array([height_m]), period_s * (count + 1))


def fallen_m(from_m, first_s, period_s=0.02):
    """Heights of a free fall, seen first so long after it began, and of what lies afterwards."""
    return [max(0.0, from_m - 9.81 / 2 * (first_s + period_s * count) ** 2) for count in range(12)]


def test_a_drop_ends_a_trial_after_it_was_lifted_and_not_before():
    judge = Judge(1, 50, 80.0, can_drop=True)
    judge.see(NO, RESTS, 0.02)
    assert judge.ended == [None]
    assert judge.see(YES, UP, 0.04).tolist() == [0]
    assert judge.see(NO, RESTS, 0.06).tolist() == []
    assert judge.ended == [End.DROP] and judge.reached.tolist() == [1]
    judge.see(YES, UP, 0.08)
    assert judge.reached.tolist() == [1], "nothing counts after the end"


@pytest.mark.parametrize("first_s", [0.0, 0.005, 0.01, 0.015])
@pytest.mark.parametrize("from_m", [0.021, 0.03, 0.06, 0.1])
def test_a_fall_is_a_drop_whenever_it_is_seen(from_m, first_s):
    judge = Judge(1, 50, 80.0, can_drop=True)
    come_down(judge, [from_m, from_m, *fallen_m(from_m, first_s)])
    assert judge.ended == [End.DROP]


def test_what_is_set_down_is_not_dropped_and_can_be_lifted_again():
    judge = Judge(1, 50, 80.0, can_drop=True)
    lowered = np.arange(0.06, 0.0, -0.12 * 0.02).tolist()
    come_down(judge, [*lowered, 0.0, 0.0, *reversed(lowered), *lowered, 0.0])
    assert judge.ended == [None]
    come_down(judge, [0.05, 0.05, *fallen_m(0.05, 0.01)])
    assert judge.ended == [End.DROP]


def test_on_the_floor_nothing_is_dropped():
    judge = Judge(1, 50, 80.0, can_drop=False)
    judge.see(NO, UP, 0.02)
    judge.see(NO, RESTS, 0.04)
    assert judge.ended == [None]


def test_80_s_without_a_goal_end_a_trial_counted_from_the_last_goal():
    judge = Judge(2, 50, 80.0, can_drop=True)
    high = np.array([0.05, 0.05])
    judge.see(np.array([True, False]), high, 60.0)
    judge.see(np.array([False, False]), high, 79.98)
    assert judge.ended == [None, None]
    judge.see(np.array([False, False]), high, 80.0)
    assert judge.ended == [None, End.TIME]
    judge.see(np.array([False, True]), high, 139.98)
    assert not judge.over
    judge.see(np.array([False, False]), high, 140.0)
    assert judge.over and judge.ended == [End.TIME, End.TIME] and judge.reached.tolist() == [1, 0]


def test_50_goals_end_a_trial_and_ask_for_no_more():
    judge = Judge(1, 50, 80.0, can_drop=True)
    asked = [len(judge.see(YES, UP, 0.1 * count)) for count in range(60)]
    assert asked == [1] * 49 + [0] * 11
    assert judge.ended == [End.ALL_REACHED] and judge.reached.tolist() == [50]


def test_in_simulation_time_ends_what_does_nothing():
    design = ManyGoals(trials=2, goals=3, limit_s=0.5, physics_step_s=0.004)
    manifest = layout_of("push")
    found = try_many_goals(lambda seen: np.zeros((len(seen), 9)), manifest, TASKS["lift"], design, None)
    assert found["ended"] == ["time", "time"] and found["reached"] == [0, 0]
    assert found["simulated_s"] == 0.5


def test_in_simulation_a_goal_that_is_reached_is_followed_by_another():
    design = ManyGoals(trials=3, goals=5, limit_s=0.3, physics_step_s=0.004, first_seed=50_000_000)
    starts = [draw_trial(TASKS["push"], design.first_seed + row)[0] for row in range(design.trials)]
    drawn, shown = [], []

    def first_here_then_far(_):
        drawn.append(None)
        place = starts[len(drawn) - 1].cube_position_world_m if len(drawn) <= 2 else np.array([[5.0, 5.0, 0.03]])
        return Goal(place, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 9)))

    def act(seen):
        shown.append(seen[:, -12:-9].copy())
        return np.zeros((len(seen), 9))

    task = replace(TASKS["push"], draw_goal=first_here_then_far)
    found = try_many_goals(act, layout_of("push"), task, design, None)
    assert found["reached"] == [1, 1, 0] and found["ended"] == ["time"] * 3
    assert np.allclose(shown[1][:, 0], 5.0) and not np.allclose(shown[0][:2, 0], 5.0), "policies see the next goal"


def test_summary_is_sorted_with_mean_and_median():
    assert summary([3, 0, 9]) == {"mean": 4.0, "deviation": np.std([3, 0, 9], ddof=1), "median": 3.0, "sorted": [9, 3, 0]}
