"""Motors cool as their time constant says, and a robot waits before they get too hot."""

import dataclasses

import numpy as np
import pytest

from robot_farm.arena.cooling import PAUSE_ABOVE_K, RESUME_BELOW_K, cooled_k, pause_s
from robot_farm.life import in_the_middle
from sim_backend.driver.driver import Command
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE

PHYSICS = Physics.of(1, {"thermal_derating.time_constant_s": 200.0})


def test_a_cool_robot_does_not_wait():
    assert pause_s(np.full(9, PAUSE_ABOVE_K), PHYSICS) == 0.0


def test_after_the_pause_the_hottest_motor_is_just_cool_enough():
    rise_k = np.array([PAUSE_ABOVE_K + 15.0, RESUME_BELOW_K - 5.0] + [0.0] * 7)
    wait_s = pause_s(rise_k, PHYSICS)
    after_k = cooled_k(rise_k, PHYSICS, wait_s)
    assert wait_s > 0
    assert after_k.max() == pytest.approx(RESUME_BELOW_K)
    assert after_k[1] == pytest.approx((RESUME_BELOW_K - 5.0) * np.exp(-wait_s / 200.0))


def test_a_real_robot_under_full_torque_gets_as_hot_as_that():
    """Robots of the real table are held at full torque from the limit on; some of their motors still get hotter."""
    physics = load_ranges("real").draw(np.random.default_rng(6), 4)
    driver = SimulatedDriver(robots=4, physics=physics)
    start = in_the_middle(CUBE)
    hot_k = np.full((4, 9), PAUSE_ABOVE_K)
    rows = {name: np.repeat(getattr(start, name), 4, axis=0) for name in ("cube_position_world_m", "cube_quat_wxyz")}
    driver.reset(dataclasses.replace(start, joint_position_rad=np.repeat(c.START_JOINT_POSITION_RAD[None], 4, axis=0), **rows))
    against_the_stops = Command(np.tile(c.MAX_TORQUE_NM * np.array([1.0, 1.0, 1.0]), (4, 3)))
    driver.advance([(against_the_stops, 1500)])
    at_the_stops = driver.measure().true_joint_position_rad
    driver.reset(dataclasses.replace(start, joint_position_rad=at_the_stops, motor_temperature_rise_k=hot_k, **rows))
    driver.advance([(against_the_stops, 500)])
    hotter_k = driver.motor_temperature_rise_k - hot_k
    assert (hotter_k > 0).any()
    assert pause_s(driver.motor_temperature_rise_k[int(hotter_k.max(axis=1).argmax())], physics.row(0)) > 0
