"""Cameras for all tests of this folder, where this machine can render."""

import pytest

import tests.unit.sim_backend.vision.before_rendering  # noqa: F401  # see there
from sim_backend.vision.cameras import Cameras, CamerasMissingError


@pytest.fixture(scope="session")
def nominal_cameras():
    """The nominal robot's cameras; skips where there is no EGL or no OpenCV."""
    try:
        cameras = Cameras()
    except CamerasMissingError as error:
        pytest.skip(str(error))
    with cameras:
        yield cameras
