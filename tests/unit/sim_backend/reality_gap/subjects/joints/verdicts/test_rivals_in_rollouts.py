"""Which other effects stand against a cause that was found in simulated motions, and what is near enough for anybody."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Hypothesis
from sim_backend.reality_gap.subjects.joints.rollouts.limits import enough_of
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Taken
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_rivals import rivals_of


def other(gain: float, effect: str, where: str):
    return gain, SimpleNamespace(squares=np.ones((1, 1))), Hypothesis(effect, where, (0,), (1.0,)), ()


def found(*others) -> list[tuple[str, str, float]]:
    taken = Taken(Hypothesis("coulomb_friction", "j1", (0,), (1.0,)), (), 100.0, tuple(others))
    selection = SimpleNamespace(taken=(taken,), problem=SimpleNamespace(windows=range(60)))
    return [(rival.effect, rival.where, rival.behind) for rival, _, _ in rivals_of(selection, taken)]


def test_all_effects_that_came_near_are_rivals_each_once():
    near = [other(99.0, "load_friction", "j1"), other(98.0, "coulomb_friction", "j2"), other(97.0, "link_mass", "j1")]
    assert found(*near, other(96.0, "link_mass", "j2"), other(95.0, "viscous_friction", "j1"), other(94.0, "gravity", "z")) == [
        ("load_friction", "j1", 1.0),
        ("link_mass", "j1", 3.0),
        ("viscous_friction", "j1", 5.0),
    ]


def test_the_best_other_effect_is_told_however_far_behind():
    assert found(other(60.0, "gravity", "z"), other(59.0, "link_mass", "j1")) == [("gravity", "z", 40.0)]
    assert found(other(90.5, "gravity", "z"), other(59.0, "link_mass", "j1")) == [("gravity", "z", 9.5)]
    assert found() == []


def test_far_windows_of_a_robot_that_swings_out_may_be_off_by_their_own_motion():
    """Most of its windows hardly move."""
    problem = SimpleNamespace(
        forward=SimpleNamespace(has_bearings=True),
        noise_rad=np.array([1e-5, 1e-3]),
        motion_rad=np.array([0.1, 0.1]),
        far_motion_rad=np.array([0.5, 0.5]),
    )
    enough = enough_of(problem)
    assert enough.usual_rad == pytest.approx([0.004 * 0.1, 5e-3]) and enough.far_rad == pytest.approx([3 * 0.004 * 0.5, 3 * 5e-3])
    assert enough.few_rad == pytest.approx([0.004 * 0.5, 3 * 5e-3]) and enough.apart == pytest.approx([5.0, 5.0])
    problem.forward.has_bearings = False
    assert (enough_of(problem).few_rad == enough_of(problem).far_rad).all(), "what sticks may be further off than what does not"
