"""Images in the formula's place: a dead camera shows nothing, a frame is rendered once, and a new trial remembers nothing."""

import numpy as np
import pytest

from sim_backend.driver.detection import values_of
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, shape_of
from sim_backend.vision.image_detector import ImageDetector, tracked_by_images

POSITION_M, QUAT = np.array([0.0, 0.03, 0.0325]), np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
STATE = c.START_JOINT_POSITION_RAD, POSITION_M, QUAT


@pytest.fixture
def detector(nominal_cameras):
    """A detector with the cameras of the nominal robot."""
    return ImageDetector(nominal_cameras)


def detected(detector, frame, physics=None):
    values = values_of(physics or Physics.nominal(1), CUBE.size_m)
    return detector(values, np.array([3]), np.array([frame]), *(each[None] for each in STATE))


def test_it_finds_the_cube_and_says_which_camera_saw_which_face(detector):
    visible, confidence, position_m, _, delay_s, lost = detected(detector, 1)
    assert np.linalg.norm(position_m[0] - POSITION_M) < 0.006 and confidence[0] > 0.75
    assert delay_s[0] == c.CAMERA_DELAY_S and not lost[0]
    faces = list(c.CUBE_FACE_COLOURS)
    assert visible[0, :, faces.index("+z")].all() and not visible[0, :, faces.index("-z")].any()


def test_a_dead_camera_shows_nothing(detector):
    dead = Physics.of(1, {"dead_camera.dead": [[0.0, 1.0, 0.0]]})
    visible, _, position_m, *_ = detected(detector, 1, dead)
    assert visible[0].any(axis=1).tolist() == [True, False, True]
    assert np.linalg.norm(position_m[0] - POSITION_M) < 0.01
    blind = Physics.of(1, {"dead_camera.dead": [[1.0, 1.0, 1.0]]})
    visible, confidence, *_ = detected(detector, 2, blind)
    assert confidence[0] == 0.0 and not visible.any()


def test_a_frame_is_rendered_once(detector):
    first = detector.images(*STATE, seed=3, frame=4)
    assert detector.images(*STATE, seed=3, frame=4) is first
    assert detector.images(*STATE, seed=3, frame=5) is not first


def test_cubes_of_any_size_are_known_and_nothing_else():
    assert tracked_by_images(CUBE) and tracked_by_images(shape_of("cube", 0.8))
    assert not any(tracked_by_images(shape_of(name)) for name in ("cuboid", "sphere", "octagonal_prism"))
