"""What the tracking effects do to frames and their timing, with statistical limits from n."""

import numpy as np
import pytest

from sim_backend.effects import noise, tracking
from sim_backend.effects.physics import Physics
from tests.unit.sim_backend.effects.test_pose_errors import N, normals, rate_margin, uniforms, within


def test_gaps_have_their_length_and_share():
    probability, frames = 0.05, 3
    uniform = noise.uniforms(np.zeros(N + 2, dtype=np.int64), np.arange(N + 2), np.array([116]))[:, 0]
    windows = np.stack([uniform[2:], uniform[1:-1], uniform[:-2]], axis=1)
    lost = tracking.dropped(np.full(N, probability), np.full(N, float(frames)), windows)
    begins = uniform[2:] < probability
    assert lost[begins].all()
    ends = np.flatnonzero(np.diff(lost.astype(int)) == -1)
    starts = np.flatnonzero(np.diff(lost.astype(int)) == 1)
    first = ends[ends > starts[0]]
    assert (first - starts[: len(first)]).min() == frames
    expected = 1 - (1 - probability) ** frames
    assert abs(lost.mean() - expected) < np.sqrt(2 * frames) * rate_margin(expected, N)


@pytest.mark.parametrize(("frames", "whole"), [(0.2, 1), (1.4, 1), (1.6, 2), (2.0, 2), (2.9999999, 3), (7.3, 7)])
def test_a_gap_lasts_the_nearest_number_of_whole_frames(frames, whole):
    assert tracking.gap_frames(frames) == whole
    uniform = np.full((1, 10), 0.5)
    for since in range(10):
        began = uniform.copy()
        began[0, since] = 0.01
        assert tracking.dropped(np.array([0.1]), np.array([frames]), began)[0] == (since < whole)


def test_delays_grow_by_a_constant_and_vary_by_the_jitter_but_never_go_back_in_time():
    delay = tracking.later_s(0.09, np.full(N, 0.02))
    assert (delay == 0.11).all()
    jittered = tracking.jittered_s(delay, np.full(N, 0.01), normals(1))
    assert within(jittered.std(ddof=1), 0.01, N)
    assert abs(jittered.mean() - 0.11) < 5 * 0.01 / np.sqrt(N)
    assert tracking.jittered_s(delay, np.full(N, 1.0), normals(1)).min() == 0.0


def test_missed_pixels_have_their_mean_and_stay_a_share():
    for mean in (0.001, 0.03, 0.2, 0.4, 0.5):
        missed = tracking.missed_share(np.full(N, mean), uniforms(1))
        std = mean * np.sqrt((1 - mean) / (1 + mean))  # of Beta(1, (1 - mean) / mean)
        assert abs(missed.mean() - mean) < 5 * std / np.sqrt(N)
        assert missed.std() == pytest.approx(std, rel=0.05)
        assert missed.min() > 0 and missed.max() < 1
    missed = tracking.missed_share(np.full(N, 0.5), uniforms(1))
    assert np.histogram(missed, 5, (0, 1))[0].max() < 0.23 * N  # half of the pixels on average: every share is as likely


def test_absent_values_change_nothing():
    zero = np.zeros(50)
    assert not tracking.dropped(zero, np.ones(50), uniforms(1)[:50]).any()
    assert not tracking.missed_share(zero, uniforms(1)[:50]).any()
    assert tracking.working(np.zeros((2, 3))).all()
    assert tracking.occluder_radius_m(0.01, 1.0) == 0.01
    np.testing.assert_array_equal(tracking.foreign_sphere(np.array([0.1]), np.array([[1.0, 2.0, 3.0]])), [[1.0, 2.0, 3.0, 0.1]])
    assert tracking.frame_period_s(tracking.NOMINAL_RATE_HZ) == 0.1


def test_bounds_are_told():
    with pytest.raises(ValueError, match=r"tracking_noise.position_m is 0.2; it must be between 0 and 0.05 m"):
        Physics.of(1, {"tracking_noise.position_m": 0.2})
