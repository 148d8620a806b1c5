"""Grasps that are chosen can be reached, press from outside and face each other."""

import numpy as np
import pytest

from sim_backend.grasping.choice import choose_grasp, side_normals
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
    assert np.linalg.norm(grasp.goal_m - goal.cube_position_world_m[0]) < c.POSITION_TOLERANCE_M / 2


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


def test_a_cube_on_its_edge_has_no_upright_faces():
    quat = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0])
    assert side_normals(rotation_matrix(quat)) is None
    assert side_normals(np.eye(3)) is not None
