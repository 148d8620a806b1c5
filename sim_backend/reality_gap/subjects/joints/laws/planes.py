"""Effects whose two images stand for any value of two numbers: a wave by amplitude and phase, a spring by stiffness and rest."""

from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import Plane, Shape, shape_of
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

_SOFTEST_NM_RAD = 1e-6
Pair = tuple[Term, Term]
"""Two terms of one number, each with a value of its shape."""


def may_be(plane: Plane, values: np.ndarray, errors: np.ndarray, sigmas: float) -> bool:
    """Whether coefficients of pairs, shape (2 n,), may be what some robot has, within so many of their standard errors."""
    if plane is Plane.WAVE:
        return True
    stiffness, error = values[::2] + values[1::2], np.hypot(errors[::2], errors[1::2])
    # a spring that is no stiffer than its error is a constant torque, which no cable gives
    return bool(np.all(stiffness + sigmas * error > 0.0) and np.any(stiffness > error))


def moved(plane: Plane, state: JointState, pair: Pair, by: tuple[float, float]) -> JointState:
    """The state with changes of a pair's coefficients put in."""
    first, (a, b) = pair[0], by
    key, j, (at, beside) = _shape(first).key, first.index, _values(pair)
    sizes, places = state.value(first.key).copy(), state.value(key).copy()
    if plane is Plane.WAVE:
        there = sizes[j] * np.exp(1j * places[j]) + a * np.exp(1j * at) + b * np.exp(1j * beside)
        sizes[j], places[j] = abs(there), np.angle(there)
    else:
        torque = sizes[j] * places[j] + a * at + b * beside
        sizes[j] = max(sizes[j] + a + b, _SOFTEST_NM_RAD)
        places[j] = np.clip(torque / sizes[j], PARAMETERS[key].lower, PARAMETERS[key].upper)
    return replace(state, given={**state.given, first.key: sizes, key: places})


def deviation(plane: Plane, state: JointState, start: JointState, pair: Pair) -> np.ndarray:
    """Changes of a pair's coefficients that lead from a start to a state, as :func:`moved` takes them, shape (2,)."""
    first, values = pair[0], np.array(_values(pair))
    key, j = _shape(first).key, first.index
    sizes, places = (np.array([s.value(name)[j] for s in (start, state)]) for name in (first.key, key))
    if plane is Plane.WAVE:
        way = np.diff(sizes * np.exp(1j * places))[0]
        return np.linalg.solve(np.stack([np.cos(values), np.sin(values)]), [way.real, way.imag])
    return np.linalg.solve(np.stack([np.ones(2), values]), [np.diff(sizes)[0], np.diff(sizes * places)[0]])


def size_and_place(
    plane: Plane, state: JointState, pair: Pair, errors: tuple[float, float]
) -> tuple[tuple[str, float, float], tuple[str, float, float]]:
    """Key, value and standard error of the size and of its place, from errors that are taken as independent of each other."""
    first, values, error = pair[0], np.array(_values(pair)), np.array(errors)
    key, j = _shape(first).key, first.index
    size, place = float(state.value(first.key)[j]), float(state.value(key)[j])
    if plane is Plane.WAVE:
        on_size, on_place = np.cos(values - place), np.sin(values - place)
    else:
        on_size, on_place = np.ones(2), values - place
    size_error = float(np.linalg.norm(on_size * error))
    return (first.key, size, size_error), (key, place, float(np.linalg.norm(on_place * error)) / max(size, 1e-12))


def _shape(term: Term) -> Shape:
    found = shape_of(term.effect)
    assert found is not None
    return found


def _values(pair: Pair) -> tuple[float, float]:
    """Of the shape, at which the images were taken."""
    key = _shape(pair[0]).key
    return dict(pair[0].shape)[key], dict(pair[1].shape)[key]
