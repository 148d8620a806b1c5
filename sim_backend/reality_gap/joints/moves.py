"""Changes of the model of joints: what the catalogue allows, and how numbers that go in pairs are put in."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.joints.hypotheses import SCALES_OF_EVERYTHING, Catalogue, Hypothesis
from sim_backend.reality_gap.joints.state import JointState, Term

_SHAPE_OF = {
    "stribeck_friction": ("stribeck_friction.speed_rad_s",),
    "thermal_derating": ("thermal_derating.time_constant_s",),
}
"""Shapes that are fitted, too, once an effect is in the model."""
_BOUND_SIGMAS = 3.0
_PLAUSIBLE_SCALE = {False: 0.25, True: 0.15}
"""A torque or a mass that is smaller by more only makes everything smaller, errors too; the more so where much is wrong."""
_PLAUSIBLE_GROWTH = {False: 0.6, True: 0.15}
"""Growth makes errors larger too, so that nothing hides in it; what several causes share stays small both ways."""


_PLAUSIBLE_GRAVITY_M_S2 = 0.15


def is_plausible(state: JointState) -> bool:
    """Whether torques, masses and gravity of a model with many causes are near enough to nominal not to hide what is missing."""
    factor, error = state.value("link_mass.factor"), state.value("torque_constant.error")
    gravity = float(np.linalg.norm(state.value("gravity.offset_m_s2")))
    off = max(float(np.abs(factor - 1.0).max()), float(np.abs(error).max()))
    return off < _PLAUSIBLE_SCALE[True] and gravity < _PLAUSIBLE_GRAVITY_M_S2


def may_be(
    terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState, *, is_group: bool, expects_many: bool
) -> bool:
    """Whether changes of some terms, within their errors, may be a cause.

    Where many things are wrong, some joints of a group may have none of it: their values are cut off at the bound.
    """
    inside = _mostly_within_bounds if is_group and expects_many else within_bounds
    if not inside(terms, values, errors, state):
        return False
    if terms[0].effect not in SCALES_OF_EVERYTHING:
        return True
    here = np.array([state.value(term.key)[term.index] for term in terms])
    absent = np.array([PARAMETERS[term.key].absent for term in terms])
    off = here + values - absent
    return bool(np.all((off > -_PLAUSIBLE_SCALE[expects_many]) & (off < _PLAUSIBLE_GROWTH[expects_many])))


def within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    """Whether some values (changes of the terms) may be, within their errors, what the catalogue allows."""
    if terms[0].effect == "cogging":
        return True
    if terms[0].effect == "joint_stiffness":
        stiffness, error = values[::2] + values[1::2], np.hypot(errors[::2], errors[1::2])
        # a spring that is no stiffer than its error is a constant torque, which no cable gives
        return bool(np.all(stiffness + _BOUND_SIGMAS * error > 0.0) and np.any(stiffness > error))
    for term, value, error in zip(terms, values, errors, strict=True):
        here, (lower, upper) = state.value(term.key)[term.index], state.bounds(term.key)
        slack = _BOUND_SIGMAS * error + 1e-12
        if not lower - slack <= here + value <= max(upper, here) + slack:
            return False
    return True


def _mostly_within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    width = 2 if terms[0].effect in ("cogging", "joint_stiffness") else 1
    parts = range(0, len(terms), width)
    inside = [within_bounds(terms[i : i + width], values[i : i + width], errors[i : i + width], state) for i in parts]
    return sum(inside) > len(inside) / 2


def moved(state: JointState, terms: Sequence[Term], values: np.ndarray) -> JointState:
    """The state with changes of some terms put in, cut off at the catalogue's bounds."""
    if terms and terms[0].effect == "cogging":
        return _moved_in_pairs(state, terms, values, _turned)
    if terms and terms[0].effect == "joint_stiffness":
        return _moved_in_pairs(state, terms, values, _sprung)
    for term, value in zip(terms, values, strict=True):
        here, (lower, upper) = float(state.value(term.key)[term.index]), state.bounds(term.key)
        wanted = float(np.clip(here + value, lower, max(upper, here)))
        state = state.moved(term, wanted - here)
    return state


def _moved_in_pairs(state, terms, values, change) -> JointState:
    for first, second, a, b in zip(terms[::2], terms[1::2], values[::2], values[1::2], strict=True):
        state = change(state, first, second, float(a), float(b))
    return state


def deviations(state: JointState, start: JointState, terms: Sequence[Term]) -> np.ndarray:
    """Changes of some terms that lead from a start to a state, as :func:`moved` takes them, shape (m,)."""
    if terms and terms[0].effect in ("cogging", "joint_stiffness"):
        pairs = zip(terms[::2], terms[1::2], strict=True)
        return np.concatenate([_pair_deviation(state, start, first, second) for first, second in pairs])
    return np.array([float(state.value(t.key)[t.index] - start.value(t.key)[t.index]) for t in terms])


def _pair_deviation(state: JointState, start: JointState, first: Term, second: Term) -> np.ndarray:
    key, j = f"{first.effect}.{'phase_rad' if first.effect == 'cogging' else 'reference_rad'}", first.index
    shapes = np.array([dict(first.shape)[key], dict(second.shape)[key]])
    sizes, places = (np.array([s.value(name)[j] for s in (start, state)]) for name in (first.key, key))
    if first.effect == "cogging":
        way = np.diff(sizes * np.exp(1j * places))[0]
        return np.linalg.solve(np.stack([np.cos(shapes), np.sin(shapes)]), [way.real, way.imag])
    return np.linalg.solve(np.stack([np.ones(2), shapes]), [np.diff(sizes)[0], np.diff(sizes * places)[0]])


def _turned(state: JointState, first: Term, second: Term, a: float, b: float) -> JointState:
    key, j = "cogging.phase_rad", first.index
    here = state.value("cogging.amplitude_nm")[j] * np.exp(1j * state.value(key)[j])
    there = here + a * np.exp(1j * dict(first.shape)[key]) + b * np.exp(1j * dict(second.shape)[key])
    amplitude, phase = state.value("cogging.amplitude_nm").copy(), state.value(key).copy()
    amplitude[j], phase[j] = abs(there), np.angle(there)
    return replace(state, given={**state.given, "cogging.amplitude_nm": amplitude, key: phase})


def _sprung(state: JointState, first: Term, second: Term, a: float, b: float) -> JointState:
    key, j = "joint_stiffness.reference_rad", first.index
    stiffness, reference = state.value("joint_stiffness.stiffness_nm_rad").copy(), state.value(key).copy()
    torque = stiffness[j] * reference[j] + a * dict(first.shape)[key] + b * dict(second.shape)[key]
    stiffness[j] = max(stiffness[j] + a + b, 1e-6)
    reference[j] = np.clip(torque / stiffness[j], PARAMETERS[key].lower, PARAMETERS[key].upper)
    return replace(state, given={**state.given, "joint_stiffness.stiffness_nm_rad": stiffness, key: reference})


def refining_terms(catalogue: Catalogue, hypothesis: Hypothesis) -> tuple[Term, ...]:
    """The hypothesis' own terms, probed closely: they are fitted around the value that the model has."""
    found = []
    for index in hypothesis.terms:
        term = catalogue.terms[index]
        sign = -1.0 if term.probe < 0.0 else 1.0
        shape = () if term.effect in _SHAPE_OF else term.shape
        found.append(Term(term.key, term.index, sign * catalogue.scales[term.key] / 100.0, shape))
        found += [Term(key, term.index, catalogue.scales[key] / 100.0) for key in _SHAPE_OF.get(term.effect, ())]
    return tuple(found)
