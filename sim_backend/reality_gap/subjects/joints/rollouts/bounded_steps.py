"""Steps of a fit within bounds: what numbers of a model may change by, the best step within that, and the model after it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from sim_backend.reality_gap.knowledge.unnamed_laws import BEARING
from sim_backend.reality_gap.subjects.joints.laws.state import NO_EFFECTS, JointState, Term

TOLERATED = 2.0
"""Standard deviations that a tolerance is."""
_AT_BOUND = 1e-6
"""Standard errors of a number: what is nearer to its bound is there."""
_ALIKE = 1e-14
"""Of the largest eigenvalue: numbers that do the same leave none along what tells them apart."""


def apart(state: JointState, other: JointState, terms: Sequence[Term]) -> np.ndarray:
    """By how much numbers of two models differ, shape (m,)."""
    return _values(state, terms) - _values(other, terms)


def _values(state: JointState, terms: Sequence[Term]) -> np.ndarray:
    return np.array([float(state.value(term.key)[term.index]) for term in terms])


def room_of(
    state: JointState, start: JointState, terms: Sequence[Term], scales: np.ndarray, causes: int
) -> tuple[np.ndarray, np.ndarray]:
    """What numbers of a model may change by, at least and at most, shapes (m,).

    Causes may go as far as the catalogue does, what a healthy robot may be off by as far as that is tolerated, and numbers of
    bearings not below none.

    Args:
        state: the model.
        start: the nominal model, about which tolerances lie.
        terms: numbers of the model.
        scales: standard deviations of the tolerances, shape (m,).
        causes: how many of the first terms are of causes.
    """
    here, nominal = _values(state, terms), _values(start, terms)
    lower, upper = nominal - TOLERATED * scales, nominal + TOLERATED * scales
    ends = np.array([ends_of(state, term) for term in terms]).reshape(-1, 2)
    is_loose = np.arange(len(terms)) >= causes
    lower = np.where(is_loose, np.maximum(lower, ends[:, 0]), ends[:, 0])
    upper = np.where(is_loose, np.minimum(upper, ends[:, 1]), ends[:, 1])
    return lower - here, upper - here


def ends_of(state: JointState, term: Term) -> tuple[float, float]:
    """Where the catalogue ends, or a number of bearings at none; a number that is beyond may stay."""
    return _ends_of(state, term, float(state.value(term.key)[term.index]))


def _ends_of(state: JointState, term: Term, here: float) -> tuple[float, float]:
    anywhere = (0.0 if term.key in BEARING else -np.inf, np.inf)
    lower, upper = anywhere if term.key in NO_EFFECTS else state.bounds(term.key)
    return min(lower, here), max(upper, here)


def step_within(
    precision: np.ndarray, pull: np.ndarray, least: np.ndarray, most: np.ndarray, kept: np.ndarray | None = None
) -> np.ndarray:
    """The step of Gauss and Newton that brings most within bounds, shape (m,).

    A step that is cut off at its bounds leaves undone what the other numbers would have made up for: a fit stops far from its
    best where several are at theirs.

    Args:
        precision: of the numbers, shape (m, m).
        pull: of the errors, shape (m,).
        least: change of each number, shape (m,).
        most: the same, shape (m,).
        kept: numbers that do not change, shape (m,); none if None. What has no room does not either.
    """
    change, free = np.zeros(len(pull)), most > least
    free &= True if kept is None else ~kept
    if not free.any():
        return change
    own, pulled, lower, upper = precision[np.ix_(free, free)], pull[free], least[free], most[free]
    try:
        step = np.linalg.solve(own, pulled)
    except np.linalg.LinAlgError:
        step = np.full(len(pulled), np.nan)
    if not ((step >= lower) & (step <= upper)).all():
        errors = 1.0 / np.sqrt(np.diag(own))
        sizes, ways = np.linalg.eigh(own * np.outer(errors, errors))
        sizes = np.sqrt(np.maximum(sizes, _ALIKE * sizes[-1]))
        found = lsq_linear(
            sizes[:, None] * ways.T, ways.T @ (pulled * errors) / sizes, (lower / errors, upper / errors), method="bvls"
        ).x
        at_lower, at_upper = found - lower / errors < _AT_BOUND, upper / errors - found < _AT_BOUND
        step = np.where(at_lower, lower, np.where(at_upper, upper, found * errors))
    change[free] = step
    return change


def moved_by(state: JointState, terms: Sequence[Term], change: np.ndarray) -> JointState:
    """Numbers changed one by one, cut off where the catalogue ends, those of bearings at none."""
    values = dict[str, np.ndarray]()
    for term, by in zip(terms, change, strict=True):
        if term.key not in values:
            values[term.key] = state.value(term.key).copy()
        here = float(values[term.key][term.index])
        lower, upper = _ends_of(state, term, here)
        values[term.key][term.index] += min(max(here + float(by), lower), upper) - here
    return replace(state, given={**state.given, **values})
