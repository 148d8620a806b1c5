"""What robots that nothing is wrong with stay below, at all of their joints together."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.healthy_robots import _below


@pytest.mark.parametrize("joints", [1, 7])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_of_healthy_robots_one_in_twenty_is_further_off_at_any_of_its_joints(joints: int, share: float):
    windows, samples, draws = 20, 5, 400
    left_rad = np.random.default_rng(2).standard_normal((windows, samples * joints, draws)) * 1e-3
    below_rad = _below(left_rad, joints, share)
    off_rad = np.sqrt(np.quantile((left_rad.reshape(windows, samples, joints, draws) ** 2).mean(axis=1), share, axis=0))
    assert below_rad.shape == (joints,)
    assert np.mean((off_rad > below_rad[:, None]).any(axis=0)) == pytest.approx(0.05, abs=0.011)
