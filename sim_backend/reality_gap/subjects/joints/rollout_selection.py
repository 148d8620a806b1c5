"""Which causes make a model go where the robot went: taken and dropped by what they gain in rollouts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import plane_of, shape_of
from sim_backend.reality_gap.subjects.joints.contradictions import is_gravity, runs_into_bounds
from sim_backend.reality_gap.subjects.joints.hypotheses import ALL_JOINTS, Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.look import Accepted
from sim_backend.reality_gap.subjects.joints.moves import moved
from sim_backend.reality_gap.subjects.joints.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.state import JointState, Term

GATE = 12.0
"""Nats that a cause must gain: odds of 160 000, shared by some hundred hypotheses."""
OF_NUMBER = 3.0
"""Nats that each number must gain for itself."""
_TRIED, _TRIED_FROM = 6, 3.0
"""So many of the best, by their linear gains in nats, are fitted."""
_MENDS = 0.5
"""A cause that gains less than this share of the largest, leaving more than noise, may only mend what that one's law leaves."""
_MOST = 6
_LEAST_REDUCTION = 0.03
"""Share of a joint's error that a cause must take away at one joint."""


@dataclass(frozen=True)
class Taken:
    """A cause in the model: an effect at a place with its terms, what it gained when it was taken, and the best other by then."""

    hypothesis: Hypothesis
    terms: tuple[Term, ...]
    gain: float
    others: tuple[tuple[tuple[str, str], float], ...]


@dataclass(frozen=True)
class RolloutSelection:
    """What rollouts came to: without any cause, and with those that were taken."""

    problem: RolloutProblem
    nominal: RolloutFit
    fit: RolloutFit
    taken: tuple[Taken, ...]


def select_by_rollouts(
    problem: RolloutProblem,
    catalogue: Catalogue,
    fits: Callable[[JointState], bool],
    progress: Callable[[str, float], None] = lambda *_: None,
) -> RolloutSelection:
    """Take the cause that gains most, fit everything anew, drop what is needed no more, until nothing gains.

    Args:
        problem: windows of recordings.
        catalogue: what may be wrong.
        fits: whether nothing measured rules a model out.
        progress: told what is done, and which share.
    """
    nominal = fit = problem.fitted(problem.start, ())
    taken: list[Taken] = []
    while len(taken) < _MOST and not problem.is_near_noise(fit):
        found = _best(problem, catalogue, fit, taken, fits)
        if found is None:
            break
        taken = [*taken, found[1]]
        fit = problem.fitted(found[0].state, [term for cause in taken for term in cause.terms], found[0].begin)
        progress(f"{found[1].hypothesis.effect}, {found[1].hypothesis.where}", 1.0 - 0.7 ** len(taken))
        fit, taken = _without_needless(problem, fit, taken)
    return RolloutSelection(problem, nominal, fit, tuple(taken))


def _best(
    problem: RolloutProblem, catalogue: Catalogue, fit: RolloutFit, taken: Sequence[Taken], fits: Callable[[JointState], bool]
) -> tuple[RolloutFit, Taken] | None:
    """What gains most of those that are possible, and the model with it."""
    own = [term for cause in taken for term in cause.terms]
    names, tried = {cause.hypothesis.name for cause in taken}, []
    for linear, hypothesis, values in _distinct(problem.gains(fit, catalogue.hypotheses), names):
        if linear < _TRIED_FROM or len(tried) == _TRIED:
            break
        terms = tuple(catalogue.terms[i] for i in hypothesis.terms)
        state, plain = _begun(problem.without_loose(fit.state, own), terms, values)
        new = problem.fitted(state, [*own, *plain], fit.begin, quickly=True)
        gain = problem.gained(fit.squares, new.squares) - OF_NUMBER * len(plain)
        with_it = [*taken, Taken(hypothesis, plain, gain, ())]
        if fits(new.state) and _may_be(problem, new.state, with_it) and _is_worth_it(fit, new):
            tried.append((gain, new, hypothesis, plain))
    tried.sort(key=lambda entry: -entry[0])
    tried = [entry for entry in tried if entry[0] >= _least(problem, entry[1], taken)]
    if not tried:
        return None
    gain, new, hypothesis, plain = _single_rather_than_all(tried)
    others = tuple((other.name, own_gain) for own_gain, _, other, _ in tried if other.name != hypothesis.name)
    return new, Taken(hypothesis, plain, gain, others)


def _least(problem: RolloutProblem, new: RolloutFit, taken: Sequence[Taken]) -> float:
    """What a cause must gain: a good share of what the first did, unless with it hardly anything is left."""
    if not taken or problem.is_near_noise(new):
        return GATE
    return max(GATE, _MENDS * max(cause.gain for cause in taken))


def _distinct(
    found: Sequence[tuple[float, Hypothesis, np.ndarray, np.ndarray]], taken: set[tuple[str, str]]
) -> list[tuple[float, Hypothesis, np.ndarray]]:
    """The best of each effect and place that is not taken."""
    best: dict[tuple[str, str], tuple[float, Hypothesis, np.ndarray]] = {}
    for gain, hypothesis, values, _ in found:
        if hypothesis.name not in taken:
            best.setdefault(hypothesis.name, (gain, hypothesis, values))
    return list(best.values())


def _single_rather_than_all(
    tried: Sequence[tuple[float, RolloutFit, Hypothesis, tuple[Term, ...]]],
) -> tuple[float, RolloutFit, Hypothesis, tuple[Term, ...]]:
    """All joints together contain what a single one is."""
    first = tried[0]
    if first[2].where != ALL_JOINTS:
        return first
    enough = first[0] - max(10.0, 0.05 * first[0])
    return next((entry for entry in tried if entry[2].where != ALL_JOINTS and entry[0] >= enough), first)


def _begun(state: JointState, terms: tuple[Term, ...], values: np.ndarray) -> tuple[JointState, tuple[Term, ...]]:
    """The model with a hypothesis' linear values put in, and the numbers that a fit moves from there."""
    if plane_of(terms[0].effect) is None:
        state = moved(state, terms, values)
        for term in terms:
            for key, value in term.shape:
                shaped = state.value(key).copy()
                shaped[term.index if len(shaped) > 1 else 0] = value
                state = replace(state, given={**state.given, key: shaped})
        return state, tuple({(t.key, t.index): replace(t, shape=()) for t in terms}.values())
    state = moved(state, terms, values)
    shape = shape_of(terms[0].effect)
    assert shape is not None, "what has a plane has a shape"
    joints, probe = sorted({t.index for t in terms}), _SHAPE_PROBE * abs(shape.values[1] - shape.values[0])
    return state, tuple(Term(key, j, by) for j in joints for key, by in ((terms[0].key, terms[0].probe), (shape.key, probe)))


_SHAPE_PROBE = 0.01
"""Of the distance between two shapes."""


def _may_be(problem: RolloutProblem, state: JointState, taken: Sequence[Taken]) -> bool:
    accepted = [Accepted(c.hypothesis.effect, c.hypothesis.where, c.terms, c.gain) for c in taken]
    return is_gravity(problem.gravity_m_s2, state) and not runs_into_bounds(state, problem.start, accepted)


def _is_worth_it(before: RolloutFit, after: RolloutFit) -> bool:
    with np.errstate(invalid="ignore"):
        usual = [np.sqrt(np.median(fit.squares, axis=0)) for fit in (before, after)]
    return bool((usual[1] < (1.0 - _LEAST_REDUCTION) * usual[0]).any())


def _without_needless(problem: RolloutProblem, fit: RolloutFit, taken: list[Taken]) -> tuple[RolloutFit, list[Taken]]:
    """Drop causes that gain nothing any more beside those that came later."""
    for cause in taken[:-1]:
        kept = [other for other in taken if other is not cause]
        state = problem.without_loose(fit.state, [term for other in taken for term in other.terms])
        for term in cause.terms:
            value = problem.start.value(term.key)[term.index] - state.value(term.key)[term.index]
            state = state.moved(term, float(value), with_shape=False)
        without = problem.fitted(state, [term for other in kept for term in other.terms], fit.begin, quickly=True)
        if problem.gained(without.squares, fit.squares) - OF_NUMBER * len(cause.terms) < GATE and _may_be(
            problem, without.state, kept
        ):
            return _without_needless(problem, without, kept)
    return fit, taken
