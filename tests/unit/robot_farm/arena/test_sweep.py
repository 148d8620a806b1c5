"""The fingers really bring the object back."""

import numpy as np
import pytest

from robot_farm.arena.motion import START_RAD
from robot_farm.arena.reset import Arena
from robot_farm.arena.sweep import REACH_M, plan_sweep
from sim_backend.driver.driver import Start
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE


def _start(azimuth_deg: float, radius_m: float = 0.155) -> Start:
    azimuth = np.deg2rad(azimuth_deg)
    position = [radius_m * np.cos(azimuth), radius_m * np.sin(azimuth), CUBE.rest_height_m]
    quat = [np.cos(azimuth / 2), 0.0, 0.0, np.sin(azimuth / 2)]
    return Start(START_RAD[None].copy(), np.array([position]), np.array([quat]))


@pytest.fixture(scope="module")
def arena():
    return Arena.new(CUBE, Physics.nominal(), _start(0.0))


def _wake(arena: Arena, start: Start) -> None:
    arena.wake(Physics.nominal(), 1, np.zeros(9), lambda: None)
    arena.place(start)
    arena.is_placed = False


@pytest.mark.parametrize("azimuth_deg", range(0, 360, 45))
def test_a_cube_at_the_wall_is_drawn_back(arena, azimuth_deg):
    events: list[str] = []
    _wake(arena, _start(azimuth_deg))
    error_rad = arena.bring_back(np.random.default_rng(azimuth_deg), events)
    start = arena.start_here()
    assert not arena.is_placed
    assert np.hypot(*start.cube_position_world_m[0, :2]) <= REACH_M
    assert error_rad is not None
    assert np.abs(error_rad).max() < 0.02
    arena.motion.hold(START_RAD, 0.2)
    np.testing.assert_allclose(arena.start_here().cube_position_world_m, start.cube_position_world_m, atol=1e-5)  # it lay still
    assert 1 <= len(events) <= 2
    assert "the object was seen 155 mm from the centre before it" in events[0]


def test_a_cube_within_reach_is_left_alone(arena):
    events: list[str] = []
    _wake(arena, _start(30.0, radius_m=0.1))
    assert arena.bring_back(np.random.default_rng(0), events) is None
    assert not events


def test_a_cube_that_nobody_can_reach_is_to_be_placed(arena):
    events: list[str] = []
    _wake(arena, _start(30.0, radius_m=0.34))
    arena.bring_back(np.random.default_rng(0), events)
    assert arena.is_placed
    assert events == ["the object is seen out of reach"]


def test_each_third_of_the_arena_has_its_finger():
    fingers = {plan_sweep(_start(azimuth).cube_position_world_m[0], CUBE, 0.05).finger for azimuth in range(0, 360, 10)}
    assert fingers == {0, 1, 2}
