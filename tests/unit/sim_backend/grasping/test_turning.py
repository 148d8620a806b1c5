"""Turns about the vertical: what goals ask for, and how the whole is put together from parts."""

import numpy as np
import pytest

from sim_backend.grasping.turning import LARGEST_RAD, about_vertical, parts_of, wrapped, yaw_between_rad
from sim_backend.tasks.keypoints import angle_between_rad, rotation_matrix
from sim_backend.tasks.task import draw_quat_wxyz


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    (w, *v), (u, *t) = first, second
    return np.array([w * u - np.dot(v, t), *(w * np.array(t) + u * np.array(v) + np.cross(v, t))])


def yaw_quat(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad / 2), 0.0, 0.0, np.sin(angle_rad / 2)])


@pytest.mark.parametrize("angle_rad", [-3.0, -1.0, 0.0, 0.4, 3.1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_turn_that_was_made_is_found(angle_rad, sign):
    before = draw_quat_wxyz(np.random.default_rng(3))
    after = sign * product(yaw_quat(angle_rad), before)
    assert yaw_between_rad(before, after) == pytest.approx(angle_rad)
    turned = about_vertical(angle_rad) @ rotation_matrix(before)
    np.testing.assert_allclose(turned, rotation_matrix(after), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_no_other_turn_brings_a_cube_nearer_to_any_orientation(seed):
    rng = np.random.default_rng(seed)
    before, goal = draw_quat_wxyz(rng), draw_quat_wxyz(rng)
    turn = yaw_between_rad(before, goal)
    left = [angle_between_rad(product(yaw_quat(turn + more), before), goal) for more in (0.0, -0.05, 0.05, 1.0, -2.0)]
    assert np.argmin(left) == 0


@pytest.mark.parametrize("turn_rad", [-3.1, -0.6, 1.0, 2.5])
def test_parts_leave_ever_more_and_always_less_than_the_whole(turn_rad):
    left = [abs(wrapped(turn_rad - part)) for part in parts_of(turn_rad)]
    assert left == sorted(left)
    assert left and max(left) < abs(turn_rad)
    assert max(map(abs, parts_of(turn_rad))) <= LARGEST_RAD + 1e-9


def test_there_is_no_part_of_nothing():
    assert parts_of(0.0) == []
