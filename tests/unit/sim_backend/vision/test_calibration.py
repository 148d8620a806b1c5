"""Calibrations: OpenCV projects as they do, files of the real robot are read, and rounded constants agree with the files."""

import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import calibration_of, nominal_calibrations
from tests.unit.sim_backend.vision.photographs import photographed_calibrations

cv2 = pytest.importorskip("cv2")
ARENA_M = np.random.default_rng(1).uniform([-0.2, -0.2, 0.0], [0.2, 0.2, 0.15], (200, 3))


@pytest.mark.parametrize("camera", nominal_calibrations(), ids=lambda camera: camera.name)
def test_opencv_projects_the_same(camera):
    turn, _ = cv2.Rodrigues(camera.rotation)
    theirs, _ = cv2.projectPoints(ARENA_M, turn, camera.translation_m, camera.matrix, camera.distortion)
    # OpenCV's rotation vector takes the file's matrix, whose rows are no unit vectors to 1e-5, for the next rotation
    np.testing.assert_allclose(camera.project(ARENA_M), theirs[:, 0], atol=0.02)


@pytest.mark.parametrize("camera", nominal_calibrations(), ids=lambda camera: camera.name)
def test_pixels_and_directions_are_inverse(camera):
    pixels = np.stack(np.meshgrid(np.linspace(0, 269, 15), np.linspace(0, 269, 15)), axis=-1)
    np.testing.assert_allclose(camera.pixels(camera.normalised(pixels)), pixels, atol=1e-6)


def test_whole_pixels_have_their_directions_in_a_table_and_others_are_computed():
    camera, rng = nominal_calibrations()[1], np.random.default_rng(2)
    whole = rng.integers(0, 270, (500, 2)).astype(float)
    alone = np.concatenate([camera.normalised(pixel[None]) for pixel in whole])
    for pixels in (whole, whole + 0.25, whole[:0], np.array([[-1.0, 3.0], [270.0, 5.0]])):
        assert camera.looked_up(pixels).tobytes() == camera.normalised(pixels).tobytes()
    assert camera.looked_up(whole).tobytes() == alone.tobytes()


def test_points_behind_a_camera_land_nowhere():
    camera = nominal_calibrations()[0]
    behind = camera.position_world_m - camera.rotation[2]
    assert np.isnan(camera.project(behind)).all()


def test_the_formula_has_the_same_cameras_rounded():
    for camera, rounded in zip(nominal_calibrations(), c.CAMERAS, strict=True):
        np.testing.assert_allclose(camera.position_world_m, rounded.position_world_m, atol=6e-4)
        np.testing.assert_allclose(camera.rotation[2], rounded.optical_axis_world, atol=6e-4)
        np.testing.assert_allclose(2 * np.array(camera.focal_px), rounded.focal_px, atol=6e-4)
        np.testing.assert_allclose(2 * np.array(camera.centre_px), rounded.centre_px, atol=6e-4)
        np.testing.assert_allclose(camera.distortion, rounded.distortion, atol=6e-6)
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=2e-4)


def test_a_resized_camera_sees_the_same_with_other_pixels():
    large = photographed_calibrations()[0]
    small = large.resized(270)
    # the pixel (0, 0) of the small image is the mean of four, whose middle is at (0.5, 0.5)
    np.testing.assert_allclose(2 * small.project(ARENA_M) + 0.5, large.project(ARENA_M), atol=1e-9)


def test_a_file_that_lacks_something_is_told_so():
    with pytest.raises(ValueError, match="no 'camera_matrix'"):
        calibration_of({"camera_name": "camera60"})
