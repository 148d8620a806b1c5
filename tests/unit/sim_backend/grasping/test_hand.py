"""Derivatives and gravity of the fingers, against MuJoCo's own."""

import mujoco
import numpy as np
import pytest

from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.scene import build_scene


@pytest.fixture(scope="module")
def model():
    return build_scene().compile()


def drawn(n: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD, (n, 9))


def test_what_holds_the_fingers_up_is_what_gravity_asks_for(model):
    data = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in c.JOINT_NAMES]
    degrees = [model.joint(name).dofadr[0] for name in c.JOINT_NAMES]
    for joints in drawn(20):
        data.qpos[places] = joints
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(gravity_torque_nm(joints), data.qfrc_bias[degrees], atol=1e-6)


def test_tips_move_as_the_jacobian_says():
    joints = drawn(5)
    small = np.random.default_rng(4).normal(0, 1e-6, (5, 9))
    moved = fingertip_position_world_m(joints + small) - fingertip_position_world_m(joints)
    said = np.einsum("nfcj,nfj->nfc", tip_jacobian(joints), small.reshape(5, 3, 3)).reshape(5, 9)
    np.testing.assert_allclose(said, moved, atol=1e-10)
