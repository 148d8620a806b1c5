"""The tracker on images: exact pixels give the pose back, renders of a robot it never saw nearly so, and nothing seen is said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.colours import BACKGROUND, FACES, LEVELS, classified, colour_table, segmented
from sim_backend.vision.pose_search import cost_px, distances_px, face_corners_m, matrices_of
from sim_backend.vision.tracking import sampled, track, track_masks
from sim_backend.vision.views import rotation_of

cv2 = pytest.importorskip("cv2")
POSITION_M, TURN_RAD = np.array([0.03, -0.04, 0.06]), np.array([0.4, -0.3, 0.9])
WIDTH_M = c.CUBE_WIDTH_M


def masks_of(position_m: np.ndarray, rotation: np.ndarray) -> list[np.ndarray]:
    """Classes of pixels of a cube alone in the world, face by face from its projected corners: no part of the tracker."""
    masks = []
    for camera in nominal_calibrations():
        mask = np.zeros((270, 270), np.uint8)
        for number, corners in enumerate(face_corners_m(WIDTH_M), 1):
            world = corners @ rotation.T + position_m
            outward = rotation @ corners.mean(axis=0)
            if outward @ (camera.position_world_m - world.mean(axis=0)) > 0.0:
                cv2.fillPoly(mask, [np.rint(camera.project(world)).astype(np.int32)], number)
        masks.append(mask)
    return masks


def test_corners_go_round_each_face_against_the_clock_seen_from_outside():
    for face, corners in zip(FACES, face_corners_m(2.0), strict=True):
        axis, sign = "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0
        assert (corners[:, axis] == sign).all()
        assert np.cross(corners[1] - corners[0], corners[2] - corners[1])[axis] * sign > 0.0


def test_pixels_cost_nothing_at_the_true_pose_and_more_elsewhere():
    rotation = Rotation.from_rotvec(TURN_RAD).as_matrix()
    rays = sampled(masks_of(POSITION_M, rotation), nominal_calibrations(), np.random.default_rng(1), 150)
    truth = np.concatenate([POSITION_M, TURN_RAD])
    beside, turned = np.array([0.02, 0, 0, 0, 0, 0]), np.array([0, 0, 0, 0.3, 0, 0])
    cost = cost_px(np.array([truth, truth + beside, truth + turned]), rays, WIDTH_M)
    assert cost[0] < 0.4 and (cost[1:] > 5 * cost[0]).all()
    distance, looks = distances_px(rays[0], POSITION_M[None], rotation[None], WIDTH_M)
    assert looks.all() and distance.max() < 1.0


def test_rotations_are_those_of_scipy():
    vectors = np.random.default_rng(2).uniform(-3, 3, (20, 3))
    np.testing.assert_allclose(matrices_of(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(matrices_of(np.zeros((1, 3)))[0], np.eye(3))


def test_exact_masks_give_the_pose_back():
    rotation = Rotation.from_rotvec(TURN_RAD).as_matrix()
    found = track_masks(masks_of(POSITION_M, rotation), nominal_calibrations(), seed=3, width_m=WIDTH_M)
    assert np.linalg.norm(found.position_world_m - POSITION_M) < 0.003
    assert Rotation.from_matrix(found.rotation.T @ rotation).magnitude() < 0.05
    np.testing.assert_allclose(rotation_of(found.quat_wxyz), found.rotation, atol=1e-9)
    assert found.confidence > 0.95


def test_the_same_seed_gives_the_same_pose():
    masks = masks_of(POSITION_M, np.eye(3))
    one, again = (track_masks(masks, nominal_calibrations(), seed=4) for _ in range(2))
    assert (one.position_world_m == again.position_world_m).all() and one.confidence == again.confidence


def test_without_a_cube_there_is_no_confidence():
    grey = np.full((270, 270, 3), 90, np.uint8)
    assert track([grey] * 3, nominal_calibrations()).confidence == 0.0


def test_a_rendered_cube_is_found(nominal_cameras):
    position, quat = np.array([0.0, 0.03, 0.0325]), np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    images = nominal_cameras.take(c.START_JOINT_POSITION_RAD, position, quat)
    found = track(images, nominal_calibrations(), seed=1)
    assert np.linalg.norm(found.position_world_m - position) < 0.01
    assert Rotation.from_matrix(found.rotation.T @ rotation_of(quat)).magnitude() < 0.2
    assert found.confidence > 0.75
    labels = nominal_cameras.labels(c.START_JOINT_POSITION_RAD, position, quat)
    both = [segmented(image) == label for image, label in zip(images, labels, strict=True)]
    assert np.mean(both) > 0.98


def test_the_table_has_every_face_and_grey_is_none():
    table = colour_table()
    assert table.shape == (LEVELS,) * 3 and set(np.unique(table)) == set(range(len(FACES) + 1))
    greys = np.repeat(np.arange(40, 200, 10, dtype=np.uint8)[None, :, None], 3, axis=2)
    assert (classified(greys) == BACKGROUND).all()
