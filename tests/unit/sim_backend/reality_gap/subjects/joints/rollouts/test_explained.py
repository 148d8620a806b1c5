"""How much of an error causes have to take to be its causes."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.rollouts.explained import explained_at
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit

NOBODY = np.empty(0)


def fit_of(off_rad) -> RolloutFit:
    """A fit whose windows end up as far off as this, shape (n, 2)."""
    return RolloutFit(None, (), 0, NOBODY, NOBODY, np.square(off_rad), (NOBODY, NOBODY))  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("left_rad", "far_rad", "gains"),
    [(0.0018, None, False), (0.0014, None, True), (0.0018, 0.003, True), (0.0021, 0.003, False)],
    ids=["too little for a healthy robot", "three fifths", "half of what is too far", "less than half"],
)
def test_of_a_robot_that_may_be_healthy_a_cause_has_to_take_more(left_rad, far_rad, gains):
    nominal, fit = fit_of(np.tile([0.001, 0.004], (8, 1))), fit_of(np.tile([0.001, left_rad], (8, 1)))
    is_gain = explained_at(nominal, fit, None if far_rad is None else np.full(2, far_rad))
    assert is_gain.tolist() == [False, gains]
