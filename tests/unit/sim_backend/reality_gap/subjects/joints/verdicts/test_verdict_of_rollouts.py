"""What a verdict says of where windows end up: with the causes, without them, and in the few that nothing explains."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_rollouts import (
    _few_windows,
    _in_model,
    _listed,
    _with_and_without,
)
from sim_backend.reality_gap.verdict import Cause
from tests.unit.sim_backend.reality_gap.subjects.joints.ends_of_windows import fit_of

NAMES, IS_SLIDE = ("cart", "pole"), np.array([True, False])


@pytest.mark.parametrize(
    ("windows", "worst_rad", "said"),
    [
        ([4, 9], 0.02, []),
        ([4, 9], 0.5, ["what happened in 2 of 32 windows: they end up as far as 500 mrad off at pole"]),
        ([4, 9], np.inf, ["what happened in 2 of 32 windows: they end up nowhere at pole"]),
        (range(20), 0.5, []),
    ],
    ids=["near enough", "two far off", "two diverge", "most of them"],
)
def test_a_few_windows_that_nothing_explains_are_told(windows, worst_rad, said):
    off_rad = np.full((32, 2), 0.01)
    off_rad[windows, 1] = worst_rad
    assert _few_windows(fit_of(off_rad), NAMES, IS_SLIDE, np.array([0.05, 0.05])) == said


@pytest.mark.parametrize(("which", "more"), [("a usual window", ""), ("one window of ten", " or more")])
def test_the_joint_that_shows_the_causes_best_is_told_in_its_own_unit(which, more):
    """Both joints gain as large a share; the pole's is within its encoder's noise."""
    nominal, fit = fit_of(np.tile([0.12, 0.004], (8, 1))), fit_of(np.tile([0.03, 0.001], (8, 1)))
    problem = SimpleNamespace(length_s=0.5, noise_rad=np.array([0.001, 0.002]))
    selection = SimpleNamespace(nominal=nominal, fit=fit, problem=problem)
    shown = np.array([True, True])
    said = _with_and_without(selection, NAMES, IS_SLIDE, shown, usual=not more)  # pyrefly: ignore[bad-argument-type]
    assert said == f"{which} of 0.5 s ends up 3 mm{more} off at cart, 12 mm without that"
    shown = np.array([False, True])
    said = _with_and_without(selection, NAMES, IS_SLIDE, shown, usual=not more)  # pyrefly: ignore[bad-argument-type]
    assert said == f"{which} of 0.5 s ends up 1 mrad{more} off at pole, 4 mrad without that"


@pytest.mark.parametrize(
    ("in_model", "said"),
    [
        ({}, "viscous friction (cart, pole), torque constant (cart)"),
        ({0: 0.05}, "less viscous friction (cart), viscous friction (pole), torque constant (cart)"),
        ({0: 0.01, 1: 0.01}, "more viscous friction (cart, pole), torque constant (cart)"),
    ],
    ids=["none", "more than there is", "less than there is"],
)
def test_of_what_the_model_has_it_is_said_whether_there_is_less_or_more(in_model, said):
    """Values are totals: 0.02 N m s/rad named in a model that has 0.05 is less friction, and nothing to add."""
    told = [("viscous_friction", "damping_nm_s_rad", name, 0.02) for name in NAMES] + [("torque_constant", "error", "cart", -0.2)]
    causes = [Cause(effect, number, where, value, "", (value, value)) for effect, number, where, value in told]
    study = SimpleNamespace(problem=SimpleNamespace(names=NAMES), problem_start=lambda _, index: in_model.get(index, 0.0))
    assert _listed(causes, _in_model(study)) == said  # pyrefly: ignore[bad-argument-type]
