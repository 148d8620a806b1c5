"""What a policy sees: late as the tracker's poses are, black where a camera is dead, and nothing that was lost."""

from types import SimpleNamespace

import numpy as np
import pytest

from robot_farm.eyes import Eyes, smaller


class Rendered:
    """Exposures that are told by their step: each pixel is the step, in tenths of a second."""

    works = np.array([True, False, True])

    def at(self, step, *_):
        return np.full((3, 270, 270, 3), max(step, 0) // 100, np.uint8)

    def of(self, steps):
        return [(step, self.at(step)) for step in steps]


def report(step):
    return SimpleNamespace(capture_step=np.array([step]))


@pytest.fixture
def eyes():
    eyes = Eyes(Rendered(), 54)
    state = np.zeros((1, 9))
    eyes.begin(SimpleNamespace(true_joint_position_rad=state, cube_position_world_m=state, cube_quat_wxyz=state))
    return eyes


def shown(eyes, step):
    images = eyes.newest(report(step))
    assert images.shape == (3, 54, 54, 3) and images.dtype == np.uint8
    assert not images[1].any(), "a dead camera shows nothing"
    assert np.ptp(images[::2]) == 0
    return int(images[0, 0, 0, 0])


def test_images_are_those_of_the_newest_report_that_has_arrived(eyes):
    eyes.take(range(100, 500, 100))
    assert shown(eyes, -100) == 0, "before the first report of the trial the scene is as it was"
    assert shown(eyes, 200) == 2
    assert shown(eyes, 200) == 2, "nothing new has arrived"
    assert shown(eyes, 400) == 4, "the frame of step 300 was lost"


def test_the_same_frame_is_the_same_array_so_that_it_is_written_once(eyes):
    eyes.take([100])
    assert eyes.newest(report(100)) is eyes.newest(report(100))


def test_frames_that_never_arrive_are_forgotten(eyes, monkeypatch):
    monkeypatch.setattr("robot_farm.eyes.MOST_UNDER_WAY", 2)
    eyes.take(range(100, 500, 100))
    assert sorted(eyes._under_way) == [300, 400]


@pytest.mark.parametrize("edge", [270, 135, 30])
def test_smaller_images_are_means_of_squares(edge):
    images = np.random.default_rng(1).integers(0, 256, (3, 270, 270, 3), dtype=np.uint8)
    factor = 270 // edge
    means = images.reshape(3, edge, factor, edge, factor, 3).mean(axis=(2, 4))
    assert np.abs(smaller(images, edge) - means).max() <= 0.5
    assert not np.shares_memory(smaller(images, edge), images)
