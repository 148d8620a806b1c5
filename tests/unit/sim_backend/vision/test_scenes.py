"""Scenes: cubes in the arena, flat or in the air, and fingers that do not go through them."""

import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.vision.rotations import matrix_of_quat
from sim_backend.vision.scenes import HIGHEST_M, drawn_scene, resting_quat


def test_a_resting_cube_has_the_wanted_face_up():
    for face, name in enumerate(c.CUBE_FACE_COLOURS):
        outward = np.eye(3)["xyz".index(name[1])] * (1 if name[0] == "+" else -1)
        for yaw_rad in (0.0, 1.0):
            np.testing.assert_allclose(matrix_of_quat(resting_quat(face, yaw_rad)) @ outward, [0, 0, 1], atol=1e-12)


def test_scenes_are_in_the_arena_and_some_fingers_are_at_the_cube():
    rng, near, flat = np.random.default_rng(1), 0, 0
    for _ in range(100):
        scene = drawn_scene(rng)
        assert (scene.joint_position_rad >= c.SOFT_LIMIT_LOWER_RAD).all()
        assert (scene.joint_position_rad <= c.SOFT_LIMIT_UPPER_RAD).all()
        assert np.linalg.norm(scene.position_world_m[:2]) <= c.MAX_CUBE_CENTRE_DISTANCE_M
        assert scene.position_world_m[2] <= HIGHEST_M and abs(np.linalg.norm(scene.quat_wxyz) - 1) < 1e-9
        flat += scene.position_world_m[2] == c.CUBE_REST_HEIGHT_M
        tips = fingertip_position_world_m(scene.joint_position_rad).reshape(3, 3) - scene.position_world_m
        outside = np.abs(tips @ matrix_of_quat(scene.quat_wxyz)) - c.CUBE_WIDTH_M / 2
        near += int((np.linalg.norm(np.maximum(outside, 0), axis=1) < 0.045).sum())
        if near:
            assert (outside.max(axis=1) > 0.0).any()
    assert 30 <= flat <= 70 and near > 40
