"""Fitted terms as numbers of the catalogue: a spring and cogging by size and place, heat at a temperature that motors reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.joints.state import JointState, Term

PLACES = {"cogging": "cogging.phase_rad", "joint_stiffness": "joint_stiffness.reference_rad"}
"""Of effects that two images together stand for: the parameter that says where they rest."""
LOSS, RISE = "thermal_derating.loss_per_k", "thermal_derating.rise_k_nm2"


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
    if terms and terms[0].effect in PLACES:
        pairs = zip(terms[::2], terms[1::2], errors[::2], errors[1::2], strict=True)
        return [value for pair in pairs for value in _size_and_place(state, *pair)]
    found = []
    for term, error in zip(terms, errors, strict=True):
        value = FittedValue(term.key, term.index, float(state.value(term.key)[term.index]), float(error))
        found += _loss_at_usual_rise(start, state, value) if term.key == LOSS else [value]
    return found


def _size_and_place(
    state: JointState, first: Term, second: Term, first_error: float, second_error: float
) -> tuple[FittedValue, FittedValue]:
    """Both errors are taken as independent of each other."""
    key = PLACES[first.effect]
    size, place = float(state.value(first.key)[first.index]), float(state.value(key)[first.index])
    shapes = np.array([dict(first.shape)[key], dict(second.shape)[key]])
    errors = np.array([first_error, second_error])
    if first.effect == "cogging":
        on_size, on_place = np.cos(shapes - place), np.sin(shapes - place)
    else:
        on_size, on_place = np.ones(2), shapes - place
    size_error = float(np.linalg.norm(on_size * errors))
    place_error = float(np.linalg.norm(on_place * errors)) / max(size, 1e-12)
    return FittedValue(first.key, first.index, size, size_error), FittedValue(key, first.index, place, place_error)


def _loss_at_usual_rise(start: JointState, state: JointState, loss: FittedValue) -> list[FittedValue]:
    """The loss for the temperature that the nominal motor reaches: joints show no more than the product of both.

    A larger robot's motor gets as warm from its own largest torque. A loss that no motor has there stays at the rise that it was
    fitted with, which is then told, too.
    """
    fitted, given = (float(s.value(RISE)[loss.index]) for s in (state, start))
    rise = given if RISE in start.given else PARAMETERS[RISE].absent / start.size**2
    if rise > 0.0 and loss.value * fitted / rise <= PARAMETERS[LOSS].upper:
        by, told = fitted / rise, rise
    else:
        by, told = 1.0, fitted
    found = [FittedValue(LOSS, loss.index, loss.value * by, loss.error * by)]
    return found if told == PARAMETERS[RISE].absent else [*found, FittedValue(RISE, loss.index, told, 0.0)]
