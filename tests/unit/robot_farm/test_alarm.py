"""What a robot notices in the middle of a trial."""

import numpy as np
import pytest

from robot_farm.alarm import SILENT_STEPS, Alarm
from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.tasks.task import draw_start


@pytest.fixture(scope="module")
def segment():
    driver = SimulatedDriver()
    driver.reset(draw_start(np.random.default_rng(0)))
    return driver.advance([(Command(np.full((1, 9), 0.1)), 20)])


def test_a_robot_in_order_notices_nothing(segment):
    alarm = Alarm()
    assert alarm.notice(segment) is None
    assert alarm.jump is None


def test_an_encoder_that_jumps_between_two_periods_is_named(segment):
    alarm, position_rad = Alarm(), segment.joint_position_rad.copy()
    alarm.notice(segment)
    position_rad[0] = segment.joint_position_rad[0, -1]
    position_rad[0, :, 4] += 0.3
    says = alarm.notice(segment._replace(joint_position_rad=position_rad))
    assert says == alarm.jump == "the encoder of joint finger120_upper_to_middle jumped by +0.30 rad"


def test_a_controller_that_sends_nothing_is_noticed(segment):
    applied_nm = segment.applied_torque_nm.copy()
    applied_nm[0, -SILENT_STEPS:] = 0.0
    assert "restarted" in str(Alarm().notice(segment._replace(applied_torque_nm=applied_nm)))


def test_torques_of_zero_at_rest_are_a_policys_right():
    driver = SimulatedDriver()
    driver.reset(Start(np.zeros((1, 9)), np.array([[0.0, 0.0, 0.0325]]), np.array([[1.0, 0.0, 0.0, 0.0]])))
    still = driver.advance([(Command(np.zeros((1, 9))), 20)])
    still = still._replace(joint_velocity_rad_s=np.zeros((1, 20, 9)), applied_torque_nm=np.zeros((1, 20, 9)))
    assert Alarm().notice(still) is None
