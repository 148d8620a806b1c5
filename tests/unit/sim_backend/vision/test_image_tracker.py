"""The tracker on images: what its pixels say it says, not seen rather than a guess, and a render of a robot it never saw."""

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_tracker import SURE, ImageTracker
from sim_backend.vision.rotations import angle_between_rad, matrix_of_quat
from sim_backend.vision.seen_pixels import NETWORK_FILE, SeenPixels, outputs_of
from tests.unit.sim_backend.vision.exact_pixels import exact_pixels

POSITION_M = np.array([0.03, -0.04, 0.06])
TURN = Rotation.from_rotvec([0.4, -0.3, 0.9]).as_matrix()


def test_exact_pixels_are_believed():
    found = ImageTracker(nominal_calibrations()).track_pixels(exact_pixels(POSITION_M, TURN), (0, 1, 2))
    assert np.linalg.norm(found.position_world_m - POSITION_M) < 1e-4 and angle_between_rad(found.rotation, TURN) < 1e-3
    np.testing.assert_allclose(matrix_of_quat(found.quat_wxyz), found.rotation, atol=1e-9)
    assert found.confidence > 0.95
    assert 0.0005 < np.sqrt(found.covariance[0, 0]) < 0.005


def test_pixels_that_fit_no_pose_are_not():
    seen, rng = exact_pixels(POSITION_M, TURN), np.random.default_rng(1)
    nonsense = [SeenPixels(each.pixel, each.face, rng.uniform(-1, 1, each.place.shape), each.expected_error) for each in seen]
    assert ImageTracker(nominal_calibrations()).track_pixels(nonsense, (0, 1, 2)).confidence < SURE


def test_a_handful_of_pixels_is_not_seen():
    few = [
        SeenPixels(each.pixel[:3], each.face[:3], each.place[:3], each.expected_error[:3])
        for each in exact_pixels(POSITION_M, TURN)
    ]
    found = ImageTracker(nominal_calibrations()).track_pixels(few, (0, 1, 2))
    assert found.confidence == 0.0 and not found.visible_faces.any() and np.isinf(found.covariance).all()


def test_nothing_is_seen_of_grey_and_without_cameras():
    tracker = ImageTracker(nominal_calibrations())
    assert tracker.track(np.full((3, 270, 270, 3), 90, np.uint8)).confidence == 0.0
    assert tracker.track(np.zeros((0, 270, 270, 3), np.uint8), ()).confidence == 0.0


def test_the_network_is_small_and_takes_any_size():
    assert NETWORK_FILE.stat().st_size < 5e6
    assert outputs_of(np.zeros((2, 50, 70, 3), np.uint8)).shape == (2, 11, 25, 35)


def test_a_render_of_a_robot_that_was_not_learnt_from_is_seen_and_without_its_cube_it_is_not(nominal_cameras):
    physics = load_ranges("real-images").draw(np.random.default_rng(77), 1)
    quat = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    position, away = np.array([0.02, 0.03, c.CUBE_REST_HEIGHT_M]), np.array([0.0, 0.0, -1.0])
    with Cameras(physics) as cameras:
        images, empty = (cameras.take(c.START_JOINT_POSITION_RAD, place, quat, seed=1) for place in (position, away))
    tracker = ImageTracker(nominal_calibrations())
    found = tracker.track(images)
    assert np.linalg.norm(found.position_world_m - position) < 0.01
    assert angle_between_rad(found.rotation, matrix_of_quat(quat)) < 0.2 and found.confidence > 0.75
    assert tracker.track(empty).confidence < 0.2
