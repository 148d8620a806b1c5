import mujoco
import numpy as np

from sim_backend.tasks.keypoints import angle_between_rad, cube_keypoints_world_m, rotation_matrix
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import elbow_position_world_m, fingertip_position_world_m, joint_position_rad
from sim_backend.trifinger.scene import compile_scene


def test_forward_kinematics_agrees_with_the_model():
    model = compile_scene()
    data = mujoco.MjData(model)
    joints = np.random.default_rng(0).uniform(-1, 1, (20, 9))
    for row, tips in zip(joints, fingertip_position_world_m(joints), strict=True):
        data.qpos[:9] = row
        mujoco.mj_kinematics(model, data)
        expected = np.concatenate([data.body(f"{finger}_tip").xpos for finger in c.FINGER_NAMES])
        np.testing.assert_allclose(tips, expected, atol=1e-12)


def test_tips_are_where_the_facts_say():
    tips = fingertip_position_world_m(np.zeros(9))
    np.testing.assert_allclose(tips[:3], [0.086, 0.0505, -0.030], atol=1e-9)
    np.testing.assert_allclose(fingertip_position_world_m(c.START_JOINT_POSITION_RAD)[2::3], 0.0791, atol=1e-4)


def test_joints_bring_the_tips_where_they_are_wanted():
    joints = np.random.default_rng(1).uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD, (500, 9))
    np.testing.assert_allclose(joint_position_rad(fingertip_position_world_m(joints)), joints, atol=1e-6)
    tips = fingertip_position_world_m(c.START_JOINT_POSITION_RAD)
    tips[3:6] *= 4
    assert np.isnan(joint_position_rad(tips)).tolist() == [False] * 3 + [True] * 3 + [False] * 3


def test_elbows_and_tips_are_a_link_apart():
    joints = np.random.default_rng(0).uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD, (50, 9))
    apart = (elbow_position_world_m(joints) - fingertip_position_world_m(joints)).reshape(50, 3, 3)
    np.testing.assert_allclose(np.linalg.norm(apart, axis=-1), -c.LINKS[3].origin_m[2])


def test_keypoint_bits_give_signs_and_clear_bits_are_plus():
    corners = cube_keypoints_world_m(np.zeros(3), np.array([1.0, 0, 0, 0])).reshape(8, 3)
    np.testing.assert_allclose(corners[0], [0.0325] * 3)
    np.testing.assert_allclose(corners[1], [-0.0325, 0.0325, 0.0325])
    np.testing.assert_allclose(corners[6], [0.0325, -0.0325, -0.0325])


def test_rotation_matrix_and_angle():
    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    np.testing.assert_allclose(rotation_matrix(quarter) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    quats = np.random.default_rng(0).standard_normal((20, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    turned = np.empty(9)
    for quat, matrix in zip(quats, rotation_matrix(quats), strict=True):
        mujoco.mju_quat2Mat(turned, quat)
        np.testing.assert_allclose(matrix.ravel(), turned, atol=1e-12)
    assert np.isclose(angle_between_rad(quarter, -np.array([1.0, 0, 0, 0])), np.pi / 2)
