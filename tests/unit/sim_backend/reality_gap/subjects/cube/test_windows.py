"""Pushes found in a log."""

import numpy as np
import pytest

from sim_backend.effects.pose_errors import CUBE_TURNS_WXYZ, quat_product
from sim_backend.reality_gap.recording import JointSignals, ObjectSignals, Recording
from sim_backend.reality_gap.subjects.cube.windows import _distance_to_square_m, flat_yaw_rad, push_windows, usable_frames
from sim_backend.trifinger import constants as c


def test_all_ways_in_which_a_cube_fits_itself_have_the_same_angle():
    yaw, quats = 0.3, []
    for turn in CUBE_TURNS_WXYZ:
        quats.append(np.empty(4))
        quat_product(np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]), turn, quats[-1])
    flat, angle = flat_yaw_rad(np.array(quats))
    assert flat.all()
    assert angle == pytest.approx(np.full(24, 0.3))


def test_a_cube_on_its_edge_does_not_lie_flat():
    assert not flat_yaw_rad(np.array([[np.cos(0.2), np.sin(0.2), 0.0, 0.0]]))[0].any()


def test_distance_from_a_turned_square():
    half = c.CUBE_WIDTH_M / 2
    along = np.array([np.cos(0.4), np.sin(0.4)])
    points = np.stack([(half + 0.01) * along, (half - 0.01) * along, np.zeros(2)])
    assert _distance_to_square_m(points, 0.4) == pytest.approx([0.01, -0.01, -half])


def test_a_repeated_pose_is_no_frame_of_its_own():
    position = np.array([[0.0, 0.0, 0.03], [0.0, 0.0, 0.03], [0.001, 0.0, 0.03]])
    cube = ObjectSignals("cube", "cube", np.arange(3.0), position, np.tile([1.0, 0, 0, 0], (3, 1)))
    assert usable_frames(cube).tolist() == [True, False, True]


def test_no_push_without_a_low_finger():
    steps = 3000
    position = np.tile(c.START_JOINT_POSITION_RAD, (steps, 1))
    joints = JointSignals(c.JOINT_NAMES, position, 0 * position, 0 * position)
    cube = ObjectSignals("cube", "cube", 0.1 * np.arange(30), np.zeros((30, 3)), np.tile([1.0, 0, 0, 0], (30, 1)))
    recording = Recording("rest", "made up", 0.001, 0.001 * np.arange(steps), joints, (cube,))
    assert push_windows(recording) == []
