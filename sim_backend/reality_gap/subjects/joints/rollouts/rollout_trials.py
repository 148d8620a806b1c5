"""Fits of one more cause, of one less, and of one instead of another, beside what a model in rollouts has."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES, SHAPES, plane_of, shape_of
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.moves import moved
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import apart
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import foretold_rad

OF_NUMBER = 3.0
"""Nats that each number must gain for itself."""
_AGAIN = 4
"""Times that a fit goes on at most which others are compared with."""
_AS_GOOD = 0.25
"""Share of a gain within which two fits are as good as each other."""
_LIMIT_PROBE = 0.01
"""Of a limit."""
_SHAPE_PROBE = 0.01
"""Of the distance between two shapes."""

Tried = tuple[float, RolloutFit, Hypothesis, tuple[Term, ...]]
"""Gain, model, and what was tried with its terms."""


def fitted_quickly(
    problem: RolloutProblem,
    fit: RolloutFit,
    own: Sequence[Term],
    hypothesis: Hypothesis,
    terms: tuple[Term, ...],
    values: np.ndarray,
    *,
    is_proposed: bool = False,
) -> Tried:
    """A cause beside what a model has, from some values on, all that a healthy robot may be off by as the nominal one has it.

    Values that something else proposed may be right where the model, and where its windows begin, bend towards wrong ones: they
    are tried with all that the model has come to, too, and with windows that begin anew.
    """
    state, plain = begun(problem.without_loose(fit.state, own), terms, values)
    begin = fit.begin
    if is_proposed:
        other = problem.begun(begun(fit.state, terms, values)[0])
        if problem.gained(problem.squares_of(state, begin), other.squares) > 0.0:
            state, begin = other.state, other.begin
    new = problem.fitted(state, [*own, *plain], begin, quickly=True)
    return problem.gained(fit.squares, new.squares) - OF_NUMBER * len(plain), new, hypothesis, plain


def fitted_wholly(
    problem: RolloutProblem,
    fit: RolloutFit,
    own: Sequence[Term],
    new: RolloutFit,
    hypothesis: Hypothesis,
    plain: tuple[Term, ...],
) -> Tried:
    """The best of some fits, which may end apart: from where a model is, and with what it had before at nominal values.

    That is its causes, or what a healthy robot may be off by: without the cause it may have made up for it, as far as it may. Of
    those that fit about as well the one counts that foretells recordings best that it has not seen: the others owe a part of what
    they gain to a few windows.
    """
    terms = [*own, *plain]
    begun: list[tuple[JointState, tuple[np.ndarray, np.ndarray] | None]] = [(new.state, new.begin)]
    begun += [(as_nominal(problem, new.state, own), new.begin)] if own else []
    loose = [term for term, _ in problem.loose_terms(terms)]
    if apart(new.state, problem.start, loose).any():
        begun.append((problem.without_loose(new.state, terms), None))
    found = [problem.fitted(state, terms, begin) for state, begin in begun]
    gains = [problem.gained(fit.squares, each.squares) - OF_NUMBER * len(plain) for each in found]
    best = int(np.argmax(gains))
    as_good = [i for i, gain in enumerate(gains) if gains[best] - gain < _AS_GOOD * max(gains[best], 0.0)]
    if len(as_good) > 1:
        best = min(as_good, key=lambda i: foretold_rad(problem, found[i], terms))
    return gains[best], found[best], hypothesis, plain


def as_nominal(problem: RolloutProblem, state: JointState, terms: Sequence[Term]) -> JointState:
    """A model with some numbers as the nominal one has them."""
    for term in terms:
        by = problem.start.value(term.key)[term.index] - state.value(term.key)[term.index]
        state = state.moved(term, float(by), with_shape=False)
    return state


def begun(state: JointState, terms: tuple[Term, ...], values: np.ndarray) -> tuple[JointState, tuple[Term, ...]]:
    """The model with a hypothesis' linear values put in, and the numbers that a fit moves from there."""
    if plane_of(terms[0].effect) is None:
        state = moved(state, terms, values)
        for term in terms:
            for key, value in term.shape:
                shaped = state.value(key).copy()
                shaped[term.index if len(shaped) > 1 else 0] = value
                state = replace(state, given={**state.given, key: shaped})
        plain = {(t.key, t.index): replace(t, shape=(), probe=_probe(t, state)) for t in terms}
        beside = {(NUMBERS[key].beside, j): replace(t, key=NUMBERS[key].beside) for (key, j), t in plain.items()}
        shapes = [
            Term(key, t.index, _SHAPE_PROBE * SCALES[key])
            for t in terms
            for key, _ in t.shape
            if key in SHAPES and SHAPES[key].scale > 0.0
        ]
        return state, (*plain.values(), *(term for (key, _), term in beside.items() if key), *shapes)
    state = moved(state, terms, values)
    shape = shape_of(terms[0].effect)
    assert shape is not None, "what has a plane has a shape"
    joints, probe = sorted({t.index for t in terms}), _SHAPE_PROBE * abs(shape.values[1] - shape.values[0])
    return state, tuple(Term(key, j, by) for j in joints for key, by in ((terms[0].key, terms[0].probe), (shape.key, probe)))


def _probe(term: Term, state: JointState) -> float:
    """Change that a fit probes a number with: of a limit a little, where what proposed it went from none to a level at once."""
    is_limit = NUMBERS[term.key].begins_at_load
    return -_LIMIT_PROBE * abs(float(state.value(term.key)[term.index])) if is_limit else term.probe


def fitted_without(problem: RolloutProblem, fit: RolloutFit, cause: Sequence[Term], others: Sequence[Term]) -> RolloutFit:
    """The nearer of two fits: of causes alone, a healthy robot's own numbers as the nominal one has them, or of all from here."""
    state = problem.without_loose(fit.state, [*others, *cause])
    quick = problem.fitted(as_nominal(problem, state, cause), others, fit.begin, quickly=True)
    whole = problem.fitted(as_nominal(problem, fit.state, cause), others, fit.begin)
    return whole if problem.gained(quick.squares, whole.squares) > 0.0 else quick


def fitted_instead(
    problem: RolloutProblem,
    fit: RolloutFit,
    cause: Sequence[Term],
    others: Sequence[Term],
    alone: RolloutFit,
    terms: Sequence[Term],
) -> RolloutFit:
    """Another's terms in the place of a cause's, fitted anew from where they are ``alone`` until that gains no more.

    A rival whose fit ends on the way would be taken for a worse one.
    """
    state = as_nominal(problem, fit.state, cause)
    for term in terms:
        by = alone.state.value(term.key)[term.index] - state.value(term.key)[term.index]
        state = state.moved(term, float(by), with_shape=False)
    return settled(problem, problem.fitted(state, [*others, *terms], fit.begin))


def gone_on(problem: RolloutProblem, before: RolloutFit, tried: Tried) -> Tried:
    """What was tried beside a model, fitted until that gains no more."""
    _, fit, hypothesis, plain = tried
    new = settled(problem, fit)
    return problem.gained(before.squares, new.squares) - OF_NUMBER * len(plain), new, hypothesis, plain


def settled(problem: RolloutProblem, fit: RolloutFit) -> RolloutFit:
    """A fit that goes on from where it ended until that gains no more."""
    for _ in range(_AGAIN):
        again = problem.fitted(fit.state, fit.terms[: fit.causes], fit.begin)
        if problem.gained(fit.squares, again.squares) < OF_NUMBER:
            break
        fit = again
    return fit
