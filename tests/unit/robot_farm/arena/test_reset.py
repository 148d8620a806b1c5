"""Placing: fingers by their encoders, objects by hand."""

import dataclasses

import numpy as np
import pytest

from robot_farm.arena.motion import START_RAD
from robot_farm.arena.reset import HAND_POSITION_M, HAND_TURN_RAD, Arena, by_hand
from robot_farm.arena.sweep import REACH_M
from robot_farm.life import in_the_middle
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE


@pytest.mark.parametrize("offset_rad", [0.0, 0.012, -0.2])
def test_fingers_are_where_their_encoders_say(offset_rad):
    physics = Physics.of(1, {"encoder_offset.offset_rad": offset_rad})
    arena = Arena.new(CUBE, physics, in_the_middle(CUBE))
    np.testing.assert_allclose(arena.driver.measure().joint_position_rad[0], START_RAD, atol=1e-12)
    arena.wake(physics, 1, np.zeros(9), lambda: None)
    arena.place(in_the_middle(CUBE))
    np.testing.assert_allclose(arena.driver.measure().joint_position_rad[0], START_RAD, atol=1e-12)
    np.testing.assert_allclose(arena.start_here().joint_position_rad[0], START_RAD - offset_rad, atol=1e-12)


def test_an_object_placed_by_hand_lies_beside_where_it_should():
    rng, wanted = np.random.default_rng(0), in_the_middle(CUBE)
    placed = [by_hand(wanted, rng) for _ in range(400)]
    beside_m = np.array([start.cube_position_world_m[0] for start in placed]) - wanted.cube_position_world_m
    np.testing.assert_allclose(beside_m[:, :2].std(axis=0), HAND_POSITION_M, rtol=0.15)
    assert not beside_m[:, 2].any()
    w, x, y, z = np.array([start.cube_quat_wxyz[0] for start in placed]).T
    assert not x.any()
    assert not y.any()
    np.testing.assert_allclose((2 * np.arctan2(z, w)).std(), HAND_TURN_RAD, rtol=0.15)


def test_an_object_on_its_side_stays_on_its_side():
    on_its_side = dataclasses.replace(in_the_middle(CUBE), cube_quat_wxyz=np.array([[0.5, 0.5, 0.5, 0.5]]))
    w, x, y, z = by_hand(on_its_side, np.random.default_rng(1)).cube_quat_wxyz[0]
    assert 2 * (x * z - w * y) == pytest.approx(0.0, abs=1e-12)
    assert 2 * (y * z + w * x) == pytest.approx(1.0)


def test_no_hand_leaves_the_object_out_of_reach():
    wanted = in_the_middle(CUBE)
    wanted.cube_position_world_m[0, :2] = [0.0, -REACH_M]
    rng = np.random.default_rng(2)
    distances_m = [np.hypot(*by_hand(wanted, rng).cube_position_world_m[0, :2]) for _ in range(50)]
    assert max(distances_m) <= REACH_M + 1e-12
    assert min(distances_m) < REACH_M
