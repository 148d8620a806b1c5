"""The other forms that a law is known in, each begun with the same numbers and with some with which it does about the same."""

import math
from collections.abc import Iterator

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term


def in_other_forms(state: JointState, term: Term) -> Iterator[JointState]:
    """The model with the law of a number in the other forms that are known of it; none where only one is.

    Forms differ in the exponent of an exponential in a speed: size and speed stay, or become those with which the area under it,
    and where it lies, stay as they are.
    """
    number, at = NUMBERS.get(term.key), term.index
    if number is None or number.form is None or number.shape is None:
        return
    key, exponents = number.form
    here, size, speed = (float(state.value(each)[at]) for each in (key, number.key, number.shape.key))
    for exponent in exponents:
        if exponent != here:
            other = speed * _middle(here) / _middle(exponent)
            area = size * speed * math.gamma(1.0 + 1.0 / here)
            as_much = area / (other * math.gamma(1.0 + 1.0 / exponent))
            formed = state.with_values({(key, at): exponent})
            yield formed
            yield formed.with_values({(number.shape.key, at): other, (number.key, at): as_much})


def _middle(exponent: float) -> float:
    """Where the area under exp(-x**exponent) lies in the mean, in speeds at which it has fallen to 1/e."""
    return math.gamma(1.0 + 2.0 / exponent) / (2.0 * math.gamma(1.0 + 1.0 / exponent))
