"""Fitted terms as numbers of the catalogue: a spring and cogging by size and place, heat at a temperature that motors reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import COGGING_CYCLES, NUMBERS, Plane, plane_of
from sim_backend.reality_gap.subjects.joints.laws import planes
from sim_backend.reality_gap.subjects.joints.laws.heating import is_usual
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

_OF_LARGEST = 0.5
"""Of the loss that a motor may have."""


@dataclass(frozen=True)
class FittedValue:
    """One number of a model: parameter, index of joint or axis, value and standard error in the parameter's unit."""

    key: str
    index: int
    value: float
    error: float


def fitted_values(start: JointState, state: JointState, terms: Sequence[Term], errors: np.ndarray) -> list[FittedValue]:
    """The numbers that a model needs for an effect.

    Args:
        start: the nominal model.
        state: with the effect.
        terms: of the effect.
        errors: their standard errors, shape (m,).
    """
    found = []
    if terms and (plane := plane_of(terms[0].effect)) is not None:
        for first, second, *own in zip(terms[::2], terms[1::2], errors[::2], errors[1::2], strict=True):
            told = planes.size_and_place(plane, state, (first, second), (own[0], own[1]))
            found += [FittedValue(key, first.index, value, error) for key, value, error in told]
            found += seen_beside(start, first)
        return found
    for term, error in zip(terms, errors, strict=True):
        value = FittedValue(term.key, term.index, float(state.value(term.key)[term.index]), float(error))
        found += at_usual_factor(start, state, value)
    return found


def seen_beside(start: JointState, term: Term) -> list[FittedValue]:
    """How often a motor cogs where that was seen in the recordings, which is told beside how much it does."""
    if plane_of(term.effect) is not Plane.WAVE or COGGING_CYCLES not in start.given:
        return []
    return [FittedValue(COGGING_CYCLES, term.index, float(start.value(COGGING_CYCLES)[term.index]), 0.0)]


def other_form(start: JointState, state: JointState, term: Term) -> list[FittedValue]:
    """Of which form a number's law is, which is told where it is another than the nominal model's."""
    number = NUMBERS.get(term.key)
    if number is None or number.form is None:
        return []
    key = number.form[0]
    usual, value = (float(each.value(key)[term.index]) for each in (start, state))
    return [] if value == usual else [FittedValue(key, term.index, value, 0.0)]


def at_usual_factor(start: JointState, state: JointState, number: FittedValue) -> list[FittedValue]:
    """Any number as it is, but a loss for the temperature that the nominal motor reaches: joints show only the product of both.

    A larger robot's motor gets as warm from its own largest torque. A loss that no motor has there is told as half of the
    largest, with the rise that goes with it.
    """
    product = NUMBERS[number.key].product_with if number.key in NUMBERS else None
    if product is None:
        return [number]
    key = product[0]
    fitted, given = (float(s.value(key)[number.index]) for s in (state, start))
    usual = PARAMETERS[key].absent
    rise = usual / start.size**2 if is_usual(start, key, number.index) else given
    largest = PARAMETERS[number.key].upper
    told, lost = fitted, number.value * fitted
    if rise > 0.0 and lost <= largest * rise:
        told = rise
    elif lost > 0.0:
        told = lost / (_OF_LARGEST * largest)
    by = fitted / told
    found = [FittedValue(number.key, number.index, number.value * by, number.error * by)]
    return found if told == usual else [*found, FittedValue(key, number.index, told, 0.0)]
