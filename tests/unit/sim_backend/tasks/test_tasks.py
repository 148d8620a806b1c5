"""Every task: drawn from its seed, valid, scored."""

import numpy as np
import pytest

from api_schemas.job import POLICY_TASKS
from api_schemas.tolerance import POSITION_TOLERANCE_M
from sim_backend.tasks import TASKS
from sim_backend.tasks.keypoints import cube_keypoints_world_m
from sim_backend.tasks.scoring import kernel, score
from sim_backend.tasks.task import draw_trial
from sim_backend.trifinger import constants as c

every_task = pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)


def test_the_api_knows_every_task():
    assert {name.value for name in POLICY_TASKS} == set(TASKS)


@every_task
def test_same_seed_same_trial_and_other_seed_other_start(task):
    first, again, other = draw_trial(task, 42), draw_trial(task, 42), draw_trial(task, 43)
    for one, two in ((first[0], again[0]), (first[1], again[1])):
        for name in one.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert (first[0].cube_position_world_m != other[0].cube_position_world_m).any()


@every_task
def test_starts_and_goals_are_valid(task):
    for seed in range(200):
        start, goal = draw_trial(task, seed)
        for pose in (start, goal):
            xy = np.hypot(*pose.cube_position_world_m[0, :2])
            assert xy <= c.MAX_CUBE_CENTRE_DISTANCE_M
            assert np.linalg.norm(pose.cube_quat_wxyz) == pytest.approx(1)
            assert cube_keypoints_world_m(pose.cube_position_world_m, pose.cube_quat_wxyz)[0, 2::3].min() >= -1e-10
        assert goal.cube_position_world_m[0, 2] <= c.MAX_GOAL_HEIGHT_M


@every_task
def test_being_at_the_goal_is_success_and_far_away_is_not(task):
    start, goal = draw_trial(task, 7)
    joints = start.joint_position_rad
    if task.moves_cube:
        at_goal = score(task, goal, goal.cube_position_world_m, goal.cube_quat_wxyz, joints)
        away = score(
            task, goal, goal.cube_position_world_m + np.array([POSITION_TOLERANCE_M + 0.001, 0, 0]), goal.cube_quat_wxyz, joints
        )
        assert at_goal.success.all()
        assert not away.success.any()
        assert at_goal.reward > away.reward
    else:
        assert not score(task, goal, start.cube_position_world_m, start.cube_quat_wxyz, joints).success.any()


def test_orientation_counts_only_where_it_should():
    turned = np.array([[np.cos(0.25), 0, 0, np.sin(0.25)]])  # 0.5 rad
    for name, counts in (("push", False), ("lift", True), ("move_cube_3", False), ("move_cube_4", True)):
        _, goal = draw_trial(TASKS[name], 1)
        flat = type(goal)(goal.cube_position_world_m, np.array([[1.0, 0, 0, 0]]), goal.fingertip_position_world_m)
        scores = score(TASKS[name], flat, flat.cube_position_world_m, turned, np.zeros((1, 9)))
        assert scores.success[0] != counts


def test_kernel_is_a_quarter_at_zero():
    assert kernel(np.array(0.0)) == 0.25
    assert kernel(np.array(0.1)) < 0.05


def test_random_face_up_is_fair():
    faces = np.zeros(6)
    for seed in range(1200):
        start, _ = draw_trial(TASKS["push"], seed)
        corners = cube_keypoints_world_m(start.cube_position_world_m, start.cube_quat_wxyz).reshape(8, 3)
        up = [
            corners[[k for k in range(8) if bool(k >> axis & 1) == bool(minus)], 2].mean()
            for axis in range(3)
            for minus in (0, 1)
        ]
        faces[int(np.argmax(up))] += 1
    assert faces.min() > 150  # 200 expected, standard deviation 13
    assert faces.max() < 250
