"""What a verdict says of where windows end up: with the causes, without them, and in the few that nothing explains."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_rollouts import _few_windows, _with_and_without

NAMES, IS_SLIDE = ("cart", "pole"), np.array([True, False])
NOBODY = np.empty(0)


def fit_of(off_rad) -> RolloutFit:
    """A fit whose windows end up as far off as this, shape (n, 2)."""
    return RolloutFit(None, (), 0, NOBODY, NOBODY, np.square(off_rad), (NOBODY, NOBODY))  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(("worst_rad", "said"), [(0.02, []), (0.5, ["what happened in 2 of 32 windows"])])
def test_a_few_windows_that_nothing_explains_are_told(worst_rad, said):
    off_rad = np.full((32, 2), 0.01)
    off_rad[[4, 9], 1] = worst_rad
    found = _few_windows(fit_of(off_rad), NAMES, IS_SLIDE, np.array([0.05, 0.05]))
    assert [each.partition(":")[0] for each in found] == said
    assert all("500 mrad off at pole" in each for each in found)


def test_the_joint_that_shows_the_causes_best_is_told_in_its_own_unit():
    nominal, fit = fit_of(np.tile([0.012, 0.02], (8, 1))), fit_of(np.tile([0.003, 0.02], (8, 1)))
    selection = SimpleNamespace(nominal=nominal, fit=fit, problem=SimpleNamespace(length_s=0.5))
    said = _with_and_without(selection, NAMES, IS_SLIDE, usual=True)  # pyrefly: ignore[bad-argument-type]
    assert said == "a usual window of 0.5 s ends up 0.3 mm off at cart, 1.2 mm without that"
