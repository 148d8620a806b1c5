"""Changes of the model of joints: what the catalogue allows, and how they are put in."""

from collections.abc import Sequence

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import FITTED, plane_of, scales_everything, shape_of
from sim_backend.reality_gap.subjects.joints.laws import planes
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term

_BOUND_SIGMAS = 3.0
_PLAUSIBLE_SCALE = {False: 0.25, True: 0.15}
"""A torque or a mass that is smaller by more only makes everything smaller, errors too; the more so where much is wrong."""
_PLAUSIBLE_GROWTH = {False: 0.6, True: 0.15}
"""Growth makes errors larger too, so that nothing hides in it; what several causes share stays small both ways."""
_REACH = 3.0
"""By which a time or a speed that decides how an effect looks is moved in one step, at most."""


def is_plausible(state: JointState) -> bool:
    """Whether a model with many causes is near enough to nominal not to hide what is missing behind all torques or masses."""
    for entry in FITTED.values():
        key = entry.numbers[0].key
        off = state.value(key) - PARAMETERS[key].absent
        if entry.scales_everything and not float(np.abs(off).max()) < _PLAUSIBLE_SCALE[True]:
            return False
        if entry.plausible_of_many and not float(np.linalg.norm(off)) < entry.plausible_of_many:
            return False
    return True


def may_be(
    terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState, *, is_group: bool, expects_many: bool
) -> bool:
    """Whether changes of some terms, within their errors, may be a cause.

    Where many things are wrong, some joints of a group may have none of it: their values are cut off at the bound.
    """
    inside = _mostly_within_bounds if is_group and expects_many else within_bounds
    if not inside(terms, values, errors, state):
        return False
    if not scales_everything(terms[0].effect):
        return True
    here = np.array([state.value(term.key)[term.index] for term in terms])
    absent = np.array([PARAMETERS[term.key].absent for term in terms])
    off = here + values - absent
    return bool(np.all((off > -_PLAUSIBLE_SCALE[expects_many]) & (off < _PLAUSIBLE_GROWTH[expects_many])))


def within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    """Whether some values (changes of the terms) may be, within their errors, what the catalogue allows."""
    plane = plane_of(terms[0].effect)
    if plane is not None:
        return planes.may_be(plane, values, errors, _BOUND_SIGMAS)
    for term, value, error in zip(terms, values, errors, strict=True):
        here, (lower, upper) = state.value(term.key)[term.index], state.bounds(term.key)
        slack = _BOUND_SIGMAS * error + 1e-12
        if not lower - slack <= here + value <= max(upper, here) + slack:
            return False
    return True


def _mostly_within_bounds(terms: Sequence[Term], values: np.ndarray, errors: np.ndarray, state: JointState) -> bool:
    width = 1 if plane_of(terms[0].effect) is None else 2
    parts = range(0, len(terms), width)
    inside = [within_bounds(terms[i : i + width], values[i : i + width], errors[i : i + width], state) for i in parts]
    return sum(inside) > len(inside) / 2


def moved(state: JointState, terms: Sequence[Term], values: np.ndarray) -> JointState:
    """The state with changes of some terms put in, cut off at the catalogue's bounds."""
    if terms and (plane := plane_of(terms[0].effect)) is not None:
        for first, second, a, b in zip(terms[::2], terms[1::2], values[::2], values[1::2], strict=True):
            state = planes.moved(plane, state, (first, second), (float(a), float(b)))
        return state
    for term, value in zip(terms, values, strict=True):
        here, (lower, upper) = float(state.value(term.key)[term.index]), state.bounds(term.key)
        wanted = float(np.clip(here + value, lower, max(upper, here)))
        state = state.moved(term, wanted - here)
    return state


def within_reach(state: JointState, terms: Sequence[Term], values: np.ndarray) -> np.ndarray:
    """Changes of some terms, those of a shape not beyond where a straight line still says something of it; shape (m,).

    A loss by heat that acts within 30 s looks, to a straight line, as if it had to act within less than none.
    """
    found = np.array(values, dtype=float)
    for i, term in enumerate(terms):
        shape = shape_of(term.effect)
        if shape is not None and shape.scale and term.key == shape.key:
            here = float(state.value(term.key)[term.index])
            found[i] = np.clip(found[i], here / _REACH - here, here * _REACH - here)
    return found


def deviations(state: JointState, start: JointState, terms: Sequence[Term]) -> np.ndarray:
    """Changes of some terms that lead from a start to a state, as :func:`moved` takes them, shape (m,)."""
    if terms and (plane := plane_of(terms[0].effect)) is not None:
        pairs = zip(terms[::2], terms[1::2], strict=True)
        return np.concatenate([planes.deviation(plane, state, start, pair) for pair in pairs])
    return np.array([float(state.value(t.key)[t.index] - start.value(t.key)[t.index]) for t in terms])


def refining_terms(catalogue: Catalogue, hypothesis: Hypothesis) -> tuple[Term, ...]:
    """The hypothesis' own terms, probed closely: they are fitted around the value that the model has."""
    found = []
    for index in hypothesis.terms:
        term = catalogue.terms[index]
        sign = -1.0 if term.probe < 0.0 else 1.0
        shape = shape_of(term.effect)
        if shape is None or shape.scale == 0.0:
            found.append(Term(term.key, term.index, sign * catalogue.scales[term.key] / 100.0, term.shape))
            continue
        found.append(Term(term.key, term.index, sign * catalogue.scales[term.key] / 100.0))
        found.append(Term(shape.key, term.index, catalogue.scales[shape.key] / 100.0))
    return tuple(found)
