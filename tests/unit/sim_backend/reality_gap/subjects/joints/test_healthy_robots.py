"""What robots that nothing is wrong with stay below, at all of their joints together."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.healthy_robots import _below


@pytest.mark.parametrize("joints", [1, 7])
def test_of_healthy_robots_one_in_twenty_is_further_off_at_any_of_its_joints(joints: int):
    off_rad = np.abs(np.random.default_rng(2).standard_normal((400, joints))) * 1e-3
    below_rad = _below(off_rad)
    assert below_rad.shape == (joints,)
    assert np.mean((off_rad > below_rad).any(axis=1)) == pytest.approx(0.05, abs=0.011)
