"""Two images that stand for any value of two numbers."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, plane_of
from sim_backend.reality_gap.subjects.joints.laws import planes
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

PLANES = [effect for effect in FITTED if plane_of(effect) is not None]
START = JointState(2)


def pair_of(effect: str) -> tuple[Term, Term]:
    number = FITTED[effect].numbers[0]
    assert number.shape is not None
    first, second = (Term(number.key, 1, 1e-3, ((number.shape.key, value),)) for value in number.shape.values)
    return first, second


@pytest.mark.parametrize("effect", PLANES)
def test_a_deviation_is_what_leads_from_one_state_to_another(effect):
    plane, pair, by = plane_of(effect), pair_of(effect), (0.011, 0.004)
    assert plane is not None
    there = planes.moved(plane, START, pair, by)
    assert planes.deviation(plane, there, START, pair) == pytest.approx(by)
    assert there.value(pair[0].key)[0] == START.value(pair[0].key)[0], "the other joint stays"


@pytest.mark.parametrize("effect", PLANES)
def test_size_and_place_are_those_of_the_state(effect):
    plane, pair = plane_of(effect), pair_of(effect)
    assert plane is not None
    there = planes.moved(plane, START, pair, (0.011, 0.004))
    for key, value, error in planes.size_and_place(plane, there, pair, (1e-4, 1e-4)):
        assert value == there.value(key)[1]
        assert 0.0 < error < np.inf
