"""What a log says about its tracker."""

import numpy as np
import pytest

from sim_backend.effects.pose_errors import CUBE_TURNS_WXYZ
from sim_backend.reality_gap.recording import ObjectSignals, Recording
from sim_backend.reality_gap.subjects.cube.tracker import tracker_statistics


def _recording(time_s, position_m, quat_wxyz, delay_s) -> Recording:
    cube = ObjectSignals("cube", "cube", time_s, position_m, quat_wxyz, time_s + delay_s, np.full(len(time_s), 0.9))
    return Recording("rest", "made up", 0.001, np.arange(10) * 0.001, None, (cube,))


def _resting(rng, frames=200, noise_m=0.001, noise_rad=0.01):
    time_s = 0.1 * np.arange(frames)
    position = np.array([0.02, 0.03, 0.0325]) + rng.normal(0.0, noise_m, (frames, 3))
    quat = np.concatenate([np.ones((frames, 1)), rng.normal(0.0, noise_rad / 2, (frames, 3))], axis=1)
    return time_s, position, quat / np.linalg.norm(quat, axis=1, keepdims=True)


def test_delay_noise_and_height_of_a_resting_cube():
    rng = np.random.default_rng(1)
    found = tracker_statistics([_recording(*_resting(rng), rng.normal(0.12, 0.005, 200))])
    assert found is not None
    assert found.delay_s == pytest.approx(0.12, abs=0.001)
    assert found.delay_std_s == pytest.approx(0.005, rel=0.2)
    assert found.interval_s == pytest.approx(0.1)
    assert found.rest_noise_m == pytest.approx(0.001, rel=0.15)
    assert found.rest_noise_rad == pytest.approx(0.01, rel=0.2)
    assert found.rest_height_m == pytest.approx(0.0325, abs=3e-4)
    assert (found.gaps, found.lost, found.jumps) == (0, 0, 0)
    assert found.confidence == pytest.approx(0.9)


def test_lost_frames_are_counted_and_so_are_the_gaps_they_make():
    time_s, position, quat = _resting(np.random.default_rng(2))
    kept = np.ones(200, dtype=bool)
    kept[[20, 50, 51, 120]] = False
    found = tracker_statistics([_recording(time_s[kept], position[kept], quat[kept], 0.09)])
    assert found is not None
    assert (found.gaps, found.lost, found.frames) == (3, 4, 196)


def test_jumps_of_the_orientation_are_counted_and_do_not_pass_for_noise():
    time_s, position, quat = _resting(np.random.default_rng(3))
    for frame, turn in ((30, 4), (31, 17), (90, 9)):
        quat[frame] = CUBE_TURNS_WXYZ[turn]
    found = tracker_statistics([_recording(time_s, position, quat, 0.09)])
    assert found is not None
    assert found.jumps == 3
    assert found.rest_noise_rad == pytest.approx(0.01, rel=0.2)


def test_a_moving_cube_is_not_at_rest():
    time_s, position, quat = _resting(np.random.default_rng(4))
    position[:, 0] += 0.05 * np.arange(200)
    found = tracker_statistics([_recording(time_s, position, quat, 0.09)])
    assert found is not None
    assert found.jump_frames == 0
    assert np.isnan(found.rest_height_m)


def test_too_few_reports_say_nothing():
    assert tracker_statistics([]) is None
    time_s, position, quat = _resting(np.random.default_rng(5), frames=5)
    assert tracker_statistics([_recording(time_s, position, quat, 0.09)]) is None
