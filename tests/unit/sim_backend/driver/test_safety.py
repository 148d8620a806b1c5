"""The safety pipeline: its order, and that what is logged is what acted."""

import numpy as np
import pytest

from sim_backend.driver.driver import Command, Start, hold_command
from sim_backend.driver.safety import applied_torque_nm
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.trifinger import constants as c

NAN = np.full(9, np.nan)
MIDDLE = np.tile([0.0, 0.9, -1.7], 3)
START = Start(MIDDLE[None], np.array([[0.0, 0.0, c.CUBE_REST_HEIGHT_M]]), np.array([[1.0, 0, 0, 0]]))


def test_clip_then_damp_then_clip():
    velocity = np.full(9, 1.0)
    applied = applied_torque_nm(np.full(9, 10.0), NAN, MIDDLE, velocity)
    np.testing.assert_allclose(applied, c.MAX_TORQUE_NM - c.SAFETY_DAMPING_NM_S_RAD)  # clipped before it is damped
    applied = applied_torque_nm(np.full(9, 0.2), NAN, MIDDLE, np.full(9, 10.0))
    np.testing.assert_allclose(applied, np.maximum(-c.MAX_TORQUE_NM, 0.2 - 10 * c.SAFETY_DAMPING_NM_S_RAD))  # and after


@pytest.mark.parametrize("side, beyond", [(c.SOFT_LIMIT_UPPER_RAD, 0.01), (c.SOFT_LIMIT_LOWER_RAD, -0.01)])
def test_outside_a_soft_limit_only_actions_that_point_back_pass(side, beyond):
    position, rest = side + beyond, np.zeros(9)
    outward, inward = np.full(9, 0.3) * np.sign(beyond), np.full(9, -0.1) * np.sign(beyond)
    expected = -beyond * c.POSITION_GAIN_NM_RAD
    np.testing.assert_allclose(applied_torque_nm(outward, NAN, position, rest), expected)
    np.testing.assert_allclose(applied_torque_nm(inward, NAN, position, rest), inward)


def test_position_command_uses_the_default_gains():
    applied = applied_torque_nm(np.zeros(9), MIDDLE + 0.01, MIDDLE, np.zeros(9))
    np.testing.assert_allclose(applied, 0.01 * c.POSITION_GAIN_NM_RAD)


def test_logged_torque_is_what_the_pure_function_says_and_what_acted():
    rng = np.random.default_rng(3)
    driver = SimulatedDriver()
    driver.reset(START)
    segments = [
        driver.advance([(Command(rng.uniform(-0.6, 0.6, (1, 9))), 10), (Command(rng.uniform(-0.6, 0.6, (1, 9))), 10)])
        for _ in range(100)
    ]
    joined = {
        name: np.concatenate([getattr(s, name) for s in segments], axis=1)
        for name in ("desired_torque_nm", "applied_torque_nm", "joint_position_rad", "joint_velocity_rad_s", "cube_quat_wxyz")
    }
    pure = applied_torque_nm(
        joined["desired_torque_nm"],
        np.full_like(joined["desired_torque_nm"], np.nan),
        joined["joint_position_rad"],
        joined["joint_velocity_rad_s"],
    )
    np.testing.assert_array_equal(pure, joined["applied_torque_nm"])
    outside = (joined["joint_position_rad"] > c.SOFT_LIMIT_UPPER_RAD) | (joined["joint_position_rad"] < c.SOFT_LIMIT_LOWER_RAD)
    assert outside.any(), "the random torques must reach a soft limit, or this test shows little"
    replay = SimulatedDriver(safety=False)
    replay.reset(START)
    again = replay.advance_torques(joined["applied_torque_nm"])
    np.testing.assert_array_equal(again.joint_position_rad, joined["joint_position_rad"])
    np.testing.assert_array_equal(again.cube_quat_wxyz, joined["cube_quat_wxyz"])


def test_hold_command_holds():
    driver = SimulatedDriver()
    driver.reset(START)
    driver.advance([(hold_command(MIDDLE[None]), 1000)])
    assert np.abs(driver.measure().joint_position_rad - MIDDLE).max() < 0.05  # kp 9 against gravity of up to 0.21 N m


def test_a_batch_moves_like_its_members_alone():
    rng = np.random.default_rng(5)
    torques = rng.uniform(-0.3, 0.3, (3, 200, 9))
    together = SimulatedDriver(robots=3, threads=2)
    together.reset(
        Start(
            *(
                np.repeat(array, 3, axis=0)
                for array in (START.joint_position_rad, START.cube_position_world_m, START.cube_quat_wxyz)
            )
        )
    )
    moved = together.advance_torques(torques)
    for index in range(3):
        alone = SimulatedDriver()
        alone.reset(START)
        np.testing.assert_array_equal(
            alone.advance_torques(torques[index : index + 1]).joint_position_rad[0], moved.joint_position_rad[index]
        )
