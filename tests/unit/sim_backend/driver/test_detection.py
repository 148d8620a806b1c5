"""What cameras make of a cube: noise, jumps, confidence and visible faces are what was set."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from sim_backend.driver.detection import confidence_of, hidden_faces
from sim_backend.driver.tracker import Tracker
from sim_backend.driver.visibility import FACES, look
from sim_backend.effects.physics import Physics
from sim_backend.effects.pose_errors import CUBE_TURNS_WXYZ
from sim_backend.trifinger.objects import shape_of
from tests.unit.sim_backend.driver.cubes import (
    REST_M,
    REST_WXYZ,
    TAILS,
    column,
    count_within,
    grasp,
    jumped,
    mean_within,
    reports,
    segment,
    start,
    std_within,
)


def test_visible_faces_are_told():
    seen = reports(seconds=0.3, position=(0.0, 0.0, 0.0325), quat=(1.0, 0.0, 0.0, 0.0))[0].visible_faces
    names = [{FACES[face] for face in np.flatnonzero(seen[0, camera])} for camera in range(3)]
    assert names == [{"+x", "+y", "+z"}, {"-y", "+z"}, {"-x", "+y", "+z"}]


@pytest.mark.parametrize("state", [{}, {"joints": grasp((0.0, 0.0, 0.06)), "position": (0.0, 0.0, 0.06), "quat": (1.0, 0, 0, 0)}])
def test_the_noise_of_frames_at_rest_and_in_a_grasp_is_what_was_set(state):
    found = reports({"tracking_noise.position_m": 0.002, "tracking_noise.rotation_rad": 0.02}, seconds=200, **state)
    error_m = column(found, "cube_position_world_m") - state.get("position", REST_M)
    true = Rotation.from_quat(np.roll(state.get("quat", REST_WXYZ), -1))
    turn = (Rotation.from_quat(np.roll(column(found, "cube_quat_wxyz"), -1, axis=1)) * true.inv()).as_rotvec()
    for axis in range(3):
        assert std_within(error_m[:, axis], 0.002) and mean_within(error_m[:, axis], 0.0, 0.002)
        assert std_within(turn[:, axis], 0.02) and mean_within(turn[:, axis], 0.0, 0.02)
    correlation = np.corrcoef(error_m[1:, 0], error_m[:-1, 0])[0, 1]
    assert abs(correlation) < norm.ppf(1 - TAILS / 2) / np.sqrt(len(error_m))  # each frame on its own


def test_the_noise_of_a_trial_stays_and_differs_between_trials():
    n = 2000
    found = reports({"tracking_episode_noise.position_m": 0.003}, n=n, seconds=0.5)
    errors = np.array([report.cube_position_world_m - REST_M for report in found])
    assert (errors == errors[0]).all()
    assert all(std_within(errors[0, :, axis], 0.003) for axis in range(3))


def test_scale_and_offset_of_the_cameras():
    found = reports({"tracking_scale.factor_error": 0.01, "tracking_offset.position_m": [[0.001, 0.0, -0.002]]})
    np.testing.assert_allclose(found[-1].cube_position_world_m[0], 1.01 * REST_M + [0.001, 0.0, -0.002], atol=1e-15)


def test_each_reading_has_noise_of_its_own():
    tracker = Tracker(physics=Physics.of(1, {"observation_noise.position_m": 0.001, "observation_noise.rotation_rad": 0.01}))
    latest = tracker.reset(start(segment(0, 20)), np.array([3]))
    readings = [tracker.reading(step) for step in range(0, 40000, 20)]
    errors = np.array([reading.cube_position_world_m[0] - REST_M for reading in readings])
    assert all(std_within(errors[:, axis], 0.001) for axis in range(3))
    assert (tracker.reading(60).cube_quat_wxyz == readings[3].cube_quat_wxyz).all()
    np.testing.assert_array_equal(latest.cube_position_world_m[0], REST_M)
    assert tracker.latest is latest


def test_jumps_of_the_orientation_come_at_the_rate_that_was_set():
    found = reports({"orientation_jumps.probability": 0.05}, seconds=200)
    assert count_within(jumped(found).sum(), len(found), 0.05)
    true = Rotation.from_quat(np.roll(REST_WXYZ, -1))
    wrong = Rotation.from_quat(np.roll(column(found, "cube_quat_wxyz")[jumped(found)], -1, axis=1))
    turns = Rotation.from_quat(np.roll(CUBE_TURNS_WXYZ, -1, axis=1))
    assert all(((true * turns).inv() * one).magnitude().min() < 1e-6 for one in wrong)


def test_jumps_are_more_frequent_in_a_grasp_as_the_hidden_faces_say():
    position, quat, joints = (0.0, 0.0, 0.06), (1.0, 0.0, 0.0, 0.0), grasp((0.0, 0.0, 0.06))
    arrays = (np.array([joints]), np.array([position]), np.array([quat]), np.full((1, 3), 0.0325), np.ones(1), np.zeros((1, 4)))
    size, seen, _ = look(*arrays, np.ones((1, 3), dtype=bool))
    hidden = hidden_faces(size, seen)[0]
    assert 0.5 < hidden < 2.0
    values = {"orientation_jumps.probability": 0.02, "orientation_jumps.growth": 5.0, "occlusion_by_fingers.strength": 1.0}
    found = reports(values, seconds=200, joints=joints, position=position, quat=quat)
    assert count_within(jumped(found, quat).sum(), len(found), 0.02 * 5.0**hidden)


def test_confidence_is_the_formula_of_the_real_tracker():
    size, seen = np.zeros((5, 3, 6)), np.zeros((5, 3, 6))
    size[:, :, :2] = 0.01
    seen[0] = size[0] > 0  # everything
    seen[1, :2] = size[1, :2] > 0  # one camera sees nothing
    seen[2, :, 0] = 1.0  # one of two faces is hidden everywhere
    seen[3, :, :2] = 0.05  # too little of each face
    sharp = seen.copy()
    seen[4], sharp[4] = size[4] > 0, 0.5 * (size[4] > 0)  # half of it beside outlines
    expected = [1.0, 0.4 * 2 / 3 + 0.3 * 2 / 3 + 0.2, 0.2 + 0.15 + 0.3, 0.0, 0.2 + 0.3 + 0.3]
    np.testing.assert_allclose(confidence_of(size, seen, sharp, np.zeros(5)), expected, atol=1e-12)
    np.testing.assert_allclose(confidence_of(size, seen, sharp, np.full(5, 0.1))[:1], [0.97 - 0.04], atol=1e-12)
    np.testing.assert_allclose(hidden_faces(size, seen), [0, 0, 1, 2 * 0.95, 0], atol=1e-12)


def test_confidence_of_a_healthy_robot_is_high_and_falls_as_the_cube_is_hidden():
    fingers = {"occlusion_by_fingers.strength": 1.0}
    clear = reports(fingers, seconds=0.3, position=(0, 0, 0.0325))[0].raw_confidence[0]
    held = reports(fingers, seconds=0.3, joints=grasp((0, 0, 0.06)), position=(0, 0, 0.06))[0].raw_confidence[0]
    ball = {"foreign_occlusion.radius_m": 0.08, "foreign_occlusion.position_m": [[0.09, 0.09, 0.16]]}
    behind = reports(ball, seconds=0.3)[0].raw_confidence[0]
    assert 0.95 < clear <= 1.0 and 0.8 < held < 0.95
    assert behind < 0.75


@pytest.mark.parametrize("thin", [{"occlusion_by_fingers.strength": 1e-9}, {"foreign_occlusion.radius_m": 1e-9}])
def test_confidence_is_full_where_what_is_in_the_way_has_no_thickness(thin):
    between = {"foreign_occlusion.position_m": [[0.1, 0.1, 0.2]]} if "foreign_occlusion.radius_m" in thin else {}
    for state in ({}, {"joints": grasp((0.0, 0.0, 0.06)), "position": (0.0, 0.0, 0.06), "quat": (1.0, 0, 0, 0)}):
        found = reports(thin | between, seconds=0.3, **state)[0]
        assert found.raw_confidence[0] == pytest.approx(1.0, abs=1e-12)


def test_missed_pixels_lower_the_confidence_by_their_share():
    found = reports({"colour_segmentation.missed": 0.04}, seconds=200)
    loss = (1.0 - column(found, "raw_confidence")) / 0.7
    assert mean_within(loss, 0.04, 0.04)


@pytest.mark.parametrize("dead", [0, 1, 2])
def test_a_dead_camera_is_below_the_laboratorys_limit_and_sees_no_face(dead):
    found = reports({"dead_camera.dead": np.eye(3)[[dead]]}, seconds=1)
    assert not found[0].visible_faces[0, dead].any()
    assert found[0].visible_faces[0].any(axis=1).sum() == 2
    assert 0.5 < found[0].raw_confidence[0] < 0.75


@pytest.mark.parametrize(("name", "scale"), [("cube", 0.6), ("cuboid", 1.0), ("sphere", 1.0), ("octagonal_prism", 1.2)])
def test_other_objects_are_seen_too(name, scale):
    shape = shape_of(name, scale)
    found = reports({"occlusion_by_fingers.strength": 1.0}, seconds=0.5, shape=shape, position=(0, 0, shape.rest_height_m))
    assert 0.9 < found[0].raw_confidence[0] <= 1.0
