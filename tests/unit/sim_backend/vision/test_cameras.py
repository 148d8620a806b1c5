"""What is rendered lies where the calibration says, absent effects leave every bit, and present ones change the images."""

import dataclasses

import numpy as np
import pytest

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import LOOKS, Acts
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration, nominal_calibrations
from sim_backend.vision.cameras import Cameras, as_it_stands
from sim_backend.vision.views import rotation_of
from tests.unit.sim_backend.effects.rig import present
from tests.unit.sim_backend.vision.photographs import photographed_calibrations

cv2 = pytest.importorskip("cv2")
AWAY_RAD = np.tile([1.0, 1.57, -2.7], 3)
"""Fingers where they hide nothing of the middle."""
OUT_OF_SIGHT_M = np.array([0.0, 0.0, 5.0])
ASIDE = np.array([0.9, 0.1, 0.2, 0.3]) / np.linalg.norm([0.9, 0.1, 0.2, 0.3])
LOOKING = [effect for effect in CATALOGUE.values() if effect.acts in LOOKS]


def silhouette(camera: Calibration, position_m: np.ndarray, quat_wxyz: np.ndarray) -> tuple[np.ndarray, float]:
    """Centroid, px, and area, px^2, of the cube's outline as the calibration alone has it: projected edges, and their hull."""
    half = c.CUBE_WIDTH_M / 2
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    share = np.linspace(0.0, 1.0, 21)[:, None]
    edges = [a + share * (b - a) for a in signs for b in signs if (a != b).sum() == 1]
    points = camera.project(np.concatenate(edges) * half @ rotation_of(quat_wxyz).T + position_m)
    moments = cv2.moments(cv2.convexHull(points.astype(np.float32)))
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"], moments["m00"]


def painted(images: np.ndarray, empty: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Centroid and area of what differs from the arena without the cube, in each image."""
    found = []
    for image, without in zip(images, empty, strict=True):
        mask = np.abs(image.astype(int) - without).max(axis=2) > 12
        rows, columns = np.nonzero(mask)
        found.append((np.array([columns.mean(), rows.mean()]), float(mask.sum())))
    return found


PLACES_M = ((0.0, 0.0, 0.04), (0.0, 0.0, 0.08), (0.08, -0.06, 0.04), (-0.08, -0.06, 0.04), (0.0, 0.1, 0.04), (0.0, -0.12, 0.04))
"""All around the arena."""
LEAST_WHOLE = 12
"""Of the 18 views of the places: in others a finger without its meshes, which is thicker, hides a part of the cube."""


def farthest_px(cameras: Cameras, calibrations: tuple[Calibration, ...]) -> float:
    """The largest distance of the painted cube's middle from that of its projected outline, in pixels of 270."""
    empty, off = cameras.take(AWAY_RAD, OUT_OF_SIGHT_M, ASIDE), list[float]()
    for position in PLACES_M:
        images = cameras.take(AWAY_RAD, np.array(position), ASIDE)
        for (centre, area), camera in zip(painted(images, empty), calibrations, strict=True):
            wanted, wanted_area = silhouette(camera, np.array(position), ASIDE)
            assert area / wanted_area < 1.06, (position, camera.name)  # mixed pixels at the edge count
            if area / wanted_area > 0.99:
                off.append(float(np.abs(centre - wanted).max()) * 270 / camera.size_px[0])
    assert len(off) >= LEAST_WHOLE
    return max(off)


def test_a_point_that_the_calibration_projects_is_painted_there(nominal_cameras):
    assert farthest_px(nominal_cameras, nominal_calibrations()) <= 0.5


def test_the_same_with_the_cameras_of_the_photographs(nominal_cameras):
    calibrations = photographed_calibrations()
    with Cameras(calibrations=calibrations) as cameras:
        assert farthest_px(cameras, calibrations) <= 0.5


def test_without_a_lens_it_would_not_lie_there():
    """The tests above can fail: a lens left out moves the cube by more than they allow."""
    for camera in nominal_calibrations():
        without = dataclasses.replace(camera, distortion=0.0 * camera.distortion)
        seen = [[silhouette(each, np.array(place), ASIDE)[0] for place in PLACES_M] for each in (camera, without)]
        assert np.abs(np.subtract(*seen)).max() > 0.5, camera.name


@pytest.mark.parametrize("effect", LOOKING, ids=lambda effect: effect.name)
def test_present_changes_the_images(effect, nominal_cameras):
    state = (c.START_JOINT_POSITION_RAD, np.array([0.0, 0.03, 0.0325]), ASIDE)
    nominal = nominal_cameras.take(*state)
    with Cameras(Physics.of(1, present(effect))) as cameras:
        assert (cameras.take(*state, seed=5, frame=3) != nominal).any()
        again = cameras.take(*state, seed=5, frame=3)
        assert (cameras.take(*state, seed=5, frame=3) == again).all(), "the same seed and frame give the same bits"


def test_labels_are_the_painted_cube_face_by_face(nominal_cameras):
    state = (AWAY_RAD, np.array(PLACES_M[1]), ASIDE)
    images, labels = nominal_cameras.take(*state), nominal_cameras.labels(*state)
    for image, label, camera in zip(images, labels, nominal_calibrations(), strict=True):
        centre, area = silhouette(camera, *state[1:])
        rows, columns = np.nonzero(label)
        assert np.abs([columns.mean() - centre[0], rows.mean() - centre[1]]).max() < 0.7 and 0.9 < len(rows) / area < 1.05
        for face in set(label[label > 0].tolist()):
            colours = image[label == face].reshape(-1, 3).astype(float)
            assert (np.abs(colours - np.median(colours, axis=0)).max(axis=1) < 40).mean() > 0.7, "a face has one paint"


def test_absent_effects_leave_every_bit(nominal_cameras):
    state = (c.START_JOINT_POSITION_RAD, np.array([0.0, 0.03, 0.0325]), ASIDE)
    absent = {effect.key(p): p.absent for effect in LOOKING for p in effect.all_parameters}
    with Cameras(Physics.of(1, absent)) as cameras:
        assert (cameras.take(*state) == nominal_cameras.take(*state)).all()


def test_noise_differs_from_frame_to_frame(nominal_cameras):
    state = (c.START_JOINT_POSITION_RAD, np.array([0.0, 0.03, 0.0325]), ASIDE)
    with Cameras(Physics.of(1, {"image_noise.reading": 0.02})) as cameras:
        assert (cameras.take(*state, frame=1) != cameras.take(*state, frame=2)).any()
        spread = (cameras.take(*state, frame=1).astype(float) - nominal_cameras.take(*state)).std()
    assert 0.6 * 0.02 * 255 < spread < 1.1 * 0.02 * 255  # less where it is cut off at black


def test_a_camera_that_stands_elsewhere_sees_points_elsewhere():
    camera = nominal_calibrations()[1]
    moved = as_it_stands(camera, Physics.of(1, {"camera_pose.right_m": 0.01}), 1)
    np.testing.assert_allclose(moved.position_world_m - camera.position_world_m, 0.01 * camera.rotation[0], atol=1e-5)
    turned = as_it_stands(camera, Physics.of(1, {"camera_pose.yaw_rad": 0.02}), 1)
    np.testing.assert_allclose(turned.position_world_m, camera.position_world_m, atol=1e-5)
    ahead = camera.position_world_m + camera.rotation[2]
    shift = turned.project(ahead) - camera.project(ahead)
    np.testing.assert_allclose(shift, [-0.02 * camera.focal_px[0], 0.0], atol=0.5)  # it looks to the right, the point goes left


def test_every_act_on_looks_has_an_effect():
    assert {effect.acts for effect in LOOKING} == {Acts.CALIBRATION, Acts.APPEARANCE, Acts.IMAGE}
