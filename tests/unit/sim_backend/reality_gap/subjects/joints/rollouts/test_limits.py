"""How far off a healthy robot's windows may end up."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import Enough, Healthy
from sim_backend.reality_gap.subjects.joints.rollouts.limits import limits_by
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import study_of

_NOBODY = np.empty(0)


def fit_of(usual_rad: float, far_rad: float) -> RolloutFit:
    """Of ten windows of one joint eight are as usual, two far off."""
    squares = np.square(np.repeat([usual_rad, far_rad], [8, 2]))[:, None]
    return RolloutFit(None, (), 0, _NOBODY, _NOBODY, squares, (_NOBODY, _NOBODY))  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("usual_mrad", "far_mrad", "moves", "is_healthy"),
    [
        (1.0, 11.0, 2.0, False),
        (1.0, 9.0, 2.0, True),
        (2.0, 11.0, 2.0, True),
        (1.0, 11.0, 5.0, True),
        (2.0, 16.0, 2.0, False),
    ],
    ids=["few windows", "few, as drawn ones", "all windows", "those that move", "more than is enough"],
)
def test_what_is_enough_for_anybody_is_so_in_all_windows_alike(usual_mrad, far_mrad, moves, is_healthy):
    drawn = Healthy(*(1e-3 * np.array([mrad]) for mrad in (1.0, 1.0, 2.0)))
    enough, fit = Enough(np.array([5e-3]), np.array([15e-3]), np.array([moves])), fit_of(1e-3 * usual_mrad, 1e-3 * far_mrad)
    assert limits_by(drawn, enough, fit).hold(fit) == is_healthy


def test_a_robot_that_is_pushed_now_and_then_is_not_healthy():
    """One window of ten ends up much further off than those of drawn robots, the others as right as can be."""
    verdict = study_of("", seconds=12.0, pushed_nm=0.04)
    assert verdict.verdict is VerdictKind.UNEXPLAINED and not verdict.causes, verdict.summary
