"""The tracker as on the real robot: pixels cost nothing at the true pose, its search comes near, nothing seen is said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.colours import BACKGROUND, LEVELS, classified, colour_table
from sim_backend.vision.pose_search import cost_px, distances_px, face_corners_m
from sim_backend.vision.reference_tracker import sampled, track_by_colours, track_masks
from sim_backend.vision.seen_pixels import FACES

cv2 = pytest.importorskip("cv2")
POSITION_M, TURN_RAD = np.array([0.03, -0.04, 0.06]), np.array([0.4, -0.3, 0.9])
WIDTH_M = c.CUBE_WIDTH_M


def masks_of(position_m, rotation):
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


def test_the_surest_of_some_searches_is_near_and_a_seed_gives_its_bits():
    masks = masks_of(POSITION_M, Rotation.from_rotvec(TURN_RAD).as_matrix())
    tries = [track_masks(masks, nominal_calibrations(), seed=seed, width_m=WIDTH_M) for seed in (0, 1, 2, 3, 0)]
    found = max(tries, key=lambda each: each.confidence)
    assert np.linalg.norm(found.position_world_m - POSITION_M) < 0.02 and found.confidence > 0.6
    assert (tries[0].position_world_m == tries[-1].position_world_m).all() and tries[0].confidence == tries[-1].confidence


def test_without_a_cube_there_is_no_confidence():
    grey = np.full((270, 270, 3), 90, np.uint8)
    assert track_by_colours([grey] * 3, nominal_calibrations()).confidence == 0.0


def test_the_table_has_every_face_and_grey_is_none():
    table = colour_table()
    assert table.shape == (LEVELS,) * 3 and set(np.unique(table)) == set(range(len(FACES) + 1))
    greys = np.repeat(np.arange(60, 180, 10, dtype=np.uint8)[None, :, None], 3, axis=2)
    assert (classified(greys) == BACKGROUND).all()
