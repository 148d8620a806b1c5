"""Grasps that are chosen can be reached, press from outside and face each other."""

import numpy as np
import pytest

from api_schemas.tolerance import POSITION_TOLERANCE_M
from sim_backend.grasping.choice import LIFTED_M, SECURE_N, choose_grasp, side_normals
from sim_backend.grasping.turning import wrapped
from sim_backend.tasks import TASKS
from sim_backend.tasks.keypoints import rotation_matrix
from sim_backend.tasks.task import draw_trial
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import joint_position_rad

CENTRE = np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M])
ABOVE = CENTRE + np.array([0.0, 0.0, 0.05])
NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@pytest.mark.parametrize("seed", range(800, 806))
def test_it_is_within_the_joints_and_the_wall_at_start_and_goal(seed):
    start, goal = draw_trial(TASKS["move_cube_3"], seed)
    cube_m = start.cube_position_world_m[0]
    normals = side_normals(rotation_matrix(start.cube_quat_wxyz[0]))
    assert normals is not None
    grasp = choose_grasp(cube_m, normals, goal.cube_position_world_m[0])
    assert grasp is not None
    for place in (cube_m, grasp.goal_m):
        joints = joint_position_rad((place + grasp.tip_m).reshape(9))
        assert (joints > c.SOFT_LIMIT_LOWER_RAD).all()
        assert (joints < c.SOFT_LIMIT_UPPER_RAD).all()
    assert np.linalg.norm(grasp.goal_m - goal.cube_position_world_m[0]) < POSITION_TOLERANCE_M / 2


def test_fingers_press_into_the_cube_and_two_of_them_face_each_other():
    grasp = choose_grasp(CENTRE, NORMALS, ABOVE)
    assert grasp is not None
    distance = -np.einsum("fi,fi->f", grasp.tip_m, grasp.inward)
    np.testing.assert_allclose(distance, c.CUBE_WIDTH_M / 2 + c.TIP_RADIUS_M)
    assert sorted((grasp.inward @ grasp.inward.T)[np.triu_indices(3, 1)]) == pytest.approx([-1.0, 0.0, 0.0])
    assert grasp.measure_n > 0


def test_the_next_best_takes_other_faces_and_is_not_more_secure():
    best, second = choose_grasp(CENTRE, NORMALS, ABOVE), choose_grasp(CENTRE, NORMALS, ABOVE, rank=1)
    assert best is not None
    assert second is not None
    assert not np.allclose(best.inward, second.inward)
    assert second.measure_n <= best.measure_n


def test_there_is_none_where_no_finger_comes():
    assert choose_grasp(np.array([0.5, 0.0, 0.03]), NORMALS, ABOVE) is None


@pytest.mark.parametrize("turn_rad", [-0.9, 0.6])
def test_a_grasp_that_turns_the_cube_is_within_reach_all_the_way(turn_rad):
    grasp = choose_grasp(CENTRE, NORMALS, ABOVE, turn_rad=turn_rad)
    assert grasp is not None
    assert (grasp.turn_rad, grasp.unfinished) == (turn_rad, False)
    for share in (0.25, 0.5, 0.75, 1.0):
        place = CENTRE + share * (grasp.goal_m - CENTRE) + [0.0, 0.0, LIFTED_M * (share < 1)]
        joints = joint_position_rad((place + grasp.turned(share * turn_rad).tip_m).reshape(9))
        assert ((joints > c.SOFT_LIMIT_LOWER_RAD) & (joints < c.SOFT_LIMIT_UPPER_RAD)).all()


@pytest.mark.parametrize("turn_rad", [-3.1, 2.9])
def test_what_one_grasp_cannot_turn_is_set_down_on_the_way_for_another_one(turn_rad):
    grasp = choose_grasp(CENTRE, NORMALS, ABOVE, turn_rad=turn_rad)
    assert grasp is not None
    assert grasp.unfinished
    assert abs(wrapped(turn_rad - grasp.turn_rad)) < abs(turn_rad) - 0.3
    np.testing.assert_allclose(grasp.goal_m, CENTRE)
    assert grasp.measure_n > SECURE_N


def test_a_turned_grasp_presses_on_the_turned_faces():
    grasp = choose_grasp(CENTRE, NORMALS, ABOVE)
    assert grasp is not None
    x, y, z = grasp.inward.T
    np.testing.assert_allclose(grasp.turned(np.pi / 2).inward, np.stack([-y, x, z], axis=1), atol=1e-12)
    assert np.array_equal(grasp.turned(0.0).tip_m, grasp.tip_m)


def test_a_cube_on_its_edge_has_no_upright_faces():
    quat = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0])
    assert side_normals(rotation_matrix(quat)) is None
    assert side_normals(np.eye(3)) is not None
