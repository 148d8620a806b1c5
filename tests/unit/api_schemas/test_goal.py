import math

import pytest
from pydantic import ValidationError

from api_schemas.goal import ARENA_RADIUS_M, IN_THE_AIR, MAX_DISTANCE_M, MAX_HEIGHT_M, ON_THE_FLOOR, REST_HEIGHT_M, OwnGoal
from api_schemas.job import POLICY_TASKS, JobRequest
from sim_backend.tasks import TASKS
from sim_backend.tasks.own import with_own
from sim_backend.tasks.task import draw_trial
from sim_backend.trifinger import constants as c

FLOOR = {"position_m": [0.05, 0.0, 0.0325]}


def request(*goals, task="push", **more):
    return JobRequest(policy="d" * 64, task=task, goals=goals, **more)


def test_the_limits_are_those_of_the_arena():
    assert pytest.approx(c.MAX_CUBE_CENTRE_DISTANCE_M) == MAX_DISTANCE_M
    assert c.ARENA_RADIUS_M == ARENA_RADIUS_M
    assert (REST_HEIGHT_M, MAX_HEIGHT_M) == (c.CUBE_REST_HEIGHT_M, c.MAX_GOAL_HEIGHT_M)


@pytest.mark.parametrize("task", sorted(ON_THE_FLOOR | IN_THE_AIR))
def test_every_task_takes_the_goals_that_it_draws_itself(task):
    for seed in range(20):
        goal = draw_trial(TASKS[task], seed)[1]
        pose = {"position_m": goal.cube_position_world_m[0].tolist(), "quat_wxyz": goal.cube_quat_wxyz[0].tolist()}
        asked = request(pose, task=task)
        assert asked.trials == 1 and asked.goals[0].position_m == pytest.approx(pose["position_m"])
    assert set(POLICY_TASKS) - ON_THE_FLOOR - IN_THE_AIR == {"reach"}


@pytest.mark.parametrize(
    ("goal", "task", "why"),
    [
        ({"position_m": [0.2, 0, 0.0325]}, "push", "lies 0.200 m from the middle"),
        ({"position_m": [0.0, 0, 0.08]}, "push", "lie on the floor"),
        ({"position_m": [0.0, 0, 0.2]}, "lift", "may be 0.0325 to 0.1 m"),
        (FLOOR | {"quat_wxyz": [0.7071, 0.7071, 0, 0]}, "floor_pose", "about the vertical alone"),
        (FLOOR | {"quat_wxyz": [1, 1, 0, 0]}, "lift", "length 1"),
        (FLOOR | {"start": {"position_m": [0.0, 0.15]}}, "push", "may at most"),
        (FLOOR, "reach", "takes no goals"),
    ],
)
def test_what_cannot_be_a_goal_is_told(goal, task, why):
    with pytest.raises(ValidationError, match=why):
        request(goal, task=task)


def test_goals_come_from_one_source():
    job = "j" + "a" * 12
    for more in ({"trials": 3}, {"like": job}, {"question": {"against": job}}):
        with pytest.raises(ValidationError):
            request(FLOOR, **more)
    with pytest.raises(ValidationError, match="leave seed and goals out"):
        JobRequest(policy="d" * 64, task="push", like=job, seed=4)
    assert request(FLOOR, FLOOR, question={"bar": 0.5}).trials == 2


def test_what_is_not_brought_is_drawn():
    start, goal = draw_trial(TASKS["push"], 3)
    own = OwnGoal.model_validate(FLOOR)
    assert with_own(start, goal, None) == (start, goal)
    same, brought = with_own(start, goal, own)
    assert same is start and brought.cube_position_world_m[0].tolist() == FLOOR["position_m"]
    placed, _ = with_own(start, goal, OwnGoal.model_validate(FLOOR | {"start": {"position_m": [0.01, 0.02], "yaw_rad": 1.0}}))
    assert placed.cube_position_world_m[0].tolist() == [0.01, 0.02, c.CUBE_REST_HEIGHT_M]
    assert placed.cube_quat_wxyz[0] == pytest.approx([math.cos(0.5), 0, 0, math.sin(0.5)])
