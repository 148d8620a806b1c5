"""Which causes make a model go where the robot went: taken and dropped by what they gain in rollouts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, plane_of, shape_of
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
DEBUG = __import__("os").environ.get("DBG")
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
    """What rollouts came to.

    Attributes:
        problem: windows of recordings.
        nominal: the model without any cause.
        fit: the model with the causes that were taken.
        taken: those causes.
        extended: the model with what else makes it go where the robot went, whether it is the cause or mends another's law.
        mending: what that is.
    """

    problem: RolloutProblem
    nominal: RolloutFit
    fit: RolloutFit
    taken: tuple[Taken, ...]
    extended: RolloutFit
    mending: tuple[Taken, ...] = ()


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
    nominal = problem.fitted(problem.start, ())
    search = _Search(problem, catalogue, fits, progress)
    fit, taken = search.extended(nominal, (), _MENDS)
    extended, all_taken = search.extended(fit, taken, 0.0) if taken else (fit, taken)
    return RolloutSelection(problem, nominal, fit, taken, extended, all_taken[len(taken) :])


@dataclass(frozen=True)
class _Search:
    """Causes are taken one by one; fields are the arguments of :func:`select_by_rollouts`."""

    problem: RolloutProblem
    catalogue: Catalogue
    fits: Callable[[JointState], bool]
    progress: Callable[[str, float], None]

    def extended(self, fit: RolloutFit, first: tuple[Taken, ...], share: float) -> tuple[RolloutFit, tuple[Taken, ...]]:
        """A model with more causes, each worth a share of the largest; those that it has stay."""
        taken = first
        while len(taken) < _MOST and not self.problem.is_near_noise(fit):
            found = _best(self.problem, self.catalogue, fit, taken, self.fits, share)
            if found is None:
                break
            taken = (*taken, found[1])
            fit = self.problem.fitted(found[0].state, [term for cause in taken for term in cause.terms], found[0].begin)
            self.progress(f"{found[1].hypothesis.effect}, {found[1].hypothesis.where}", 1.0 - 0.7 ** len(taken))
            fit, taken = _without_needless(self.problem, fit, taken, first)
        return fit, taken


def _best(
    problem: RolloutProblem,
    catalogue: Catalogue,
    fit: RolloutFit,
    taken: Sequence[Taken],
    fits: Callable[[JointState], bool],
    share: float,
) -> tuple[RolloutFit, Taken] | None:
    """What gains most of those that are possible, and the model with it; ``share`` as of :func:`_least`."""
    own = [term for cause in taken for term in cause.terms]
    names, tried = {cause.hypothesis.name for cause in taken}, []
    for linear, hypothesis, values in _distinct(problem.gains(fit, catalogue.hypotheses), names):
        if linear < _TRIED_FROM or len(tried) == _TRIED:
            break
        terms = tuple(catalogue.terms[i] for i in hypothesis.terms)
        state, plain = _begun(problem.without_loose(fit.state, own), terms, values)
        new = problem.fitted(state, [*own, *plain], fit.begin, quickly=True)
        if own:  # those before may have found another place without it
            afresh = problem.fitted(_as_nominal(problem, state, own), [*own, *plain], fit.begin, quickly=True)
            new = max(new, afresh, key=lambda each: problem.gained(fit.squares, each.squares))
        gain = problem.gained(fit.squares, new.squares) - OF_NUMBER * len(plain)
        with_it = [*taken, Taken(hypothesis, plain, gain, ())]
        if fits(new.state) and _may_be(problem, new.state, with_it) and _is_worth_it(fit, new):
            tried.append((gain, new, hypothesis, plain))
    tried.sort(key=lambda entry: -entry[0])
    tried = [entry for entry in tried if entry[0] >= _least(problem, entry[1], taken, share)]
    if not tried:
        return None
    gain, new, hypothesis, plain = _single_rather_than_all(tried)
    if DEBUG:
        for entry in tried:
            cv = 0.0
            print("   tried", entry[2].name, "gain", round(entry[0],1), "foretold", round(cv,1), {f"{t.key}@{t.index}": float(entry[1].state.value(t.key)[t.index]) for t in entry[3]}, flush=True)
    others = tuple((other.name, own_gain) for own_gain, _, other, _ in tried if other.name != hypothesis.name)
    return new, Taken(hypothesis, plain, gain, others)


def _as_nominal(problem: RolloutProblem, state: JointState, terms: Sequence[Term]) -> JointState:
    """A model with some numbers as the nominal one has them."""
    for term in terms:
        by = problem.start.value(term.key)[term.index] - state.value(term.key)[term.index]
        state = state.moved(term, float(by), with_shape=False)
    return state


def _least(problem: RolloutProblem, new: RolloutFit, taken: Sequence[Taken], share: float) -> float:
    """What a cause must gain: a share of what the largest did, unless with it hardly anything is left."""
    if not taken or problem.is_near_noise(new):
        return GATE
    return max(GATE, share * max(cause.gain for cause in taken))


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
        plain = {(t.key, t.index): replace(t, shape=()) for t in terms}
        beside = {(NUMBERS[key].beside, j): replace(t, key=NUMBERS[key].beside) for (key, j), t in plain.items()}
        return state, (*plain.values(), *(term for (key, _), term in beside.items() if key))
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


def _without_needless(
    problem: RolloutProblem, fit: RolloutFit, taken: tuple[Taken, ...], first: tuple[Taken, ...]
) -> tuple[RolloutFit, tuple[Taken, ...]]:
    """Drop causes that gain nothing any more beside those that came later, but for the first ones."""
    for cause in taken[len(first) : -1]:
        kept = tuple(other for other in taken if other is not cause)
        state = problem.without_loose(fit.state, [term for other in taken for term in other.terms])
        state = _as_nominal(problem, state, cause.terms)
        without = problem.fitted(state, [term for other in kept for term in other.terms], fit.begin, quickly=True)
        if problem.gained(without.squares, fit.squares) - OF_NUMBER * len(cause.terms) < GATE and _may_be(
            problem, without.state, kept
        ):
            return _without_needless(problem, without, kept, first)
    return fit, taken
