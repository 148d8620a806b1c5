"""Causes that a robot needs: one without which it goes no further off than healthy robots with the others is not named.

A fit takes whatever helps. A cause that only mends what another's law leaves, or what a healthy robot may differ by, gains many
nats where noise is small, and moves windows hardly at all.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.knowledge.unnamed_laws import DRY
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import apart
from sim_backend.reality_gap.subjects.joints.rollouts.explained import EXPLAINED
from sim_backend.reality_gap.subjects.joints.rollouts.limits import HealthyLimits
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Taken, stays_within
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, only_at, without

_CLEAR = 0.2
"""Share of what a cause gained: what loses more is needed, however little further off a robot ends up without it."""

Limits = Callable[[RolloutFit], HealthyLimits]
"""Of robots that have some causes and are healthy else, to compare a model with."""


def with_needed_causes(selection: RolloutSelection, limits: Limits, fits: Callable[[JointState], bool]) -> RolloutSelection:
    """A selection of which each cause gains clearly, takes away half of an error somewhere, or what no healthy robot leaves.

    Where causes are several those that gained least are asked first; one of all joints that only one of them needs is that one's.
    Of several dry frictions of one joint those that gained less have to take what no healthy robot leaves: how friction sets in
    again when a joint turns about is each robot's own, and each simulator's, and looks like more of it near standstill.
    What is not needed stays in the extended model; nothing goes without which a model would be one that no robot can have.

    Args:
        selection: causes and models.
        limits: of robots that have these causes and are healthy else.
        fits: whether nothing measured rules a model out.
    """
    problem = selection.problem
    largest = max((cause.gain for cause in selection.taken), default=0.0)

    def goes_without(less: RolloutFit, rest: Sequence[Taken], gain: float) -> bool:
        may_be = fits(less.state) and stays_within(problem, less, rest)
        return may_be and not _is_needed(problem, less, selection.fit, gain, limits)

    for cause in sorted(selection.taken, key=lambda taken: taken.gain) if len(selection.taken) > 1 else ():
        rest, less = tuple(other for other in selection.taken if other is not cause), without(selection, cause)
        is_usual = _sets_in(cause, rest) and fits(less.state) and limits(less).hold(less)
        if is_usual or goes_without(less, rest, largest):
            found = replace(selection, fit=less, taken=rest, mending=(*selection.mending, cause))
            return with_needed_causes(found, limits, fits)
    for cause in selection.taken:
        single = _clearest(selection, cause)
        if single is None:
            continue
        fit = only_at(selection, cause, single.terms)
        taken = tuple(single if other is cause else other for other in selection.taken)
        if goes_without(fit, taken, cause.gain):
            return with_needed_causes(replace(selection, fit=fit, taken=taken), limits, fits)
    return selection


def _sets_in(cause: Taken, rest: Sequence[Taken]) -> bool:
    """Whether a cause is a dry friction beside another that gained more, at all of its joints."""
    kin = {t.index for other in rest if other.hypothesis.effect in DRY and other.gain > cause.gain for t in other.terms}
    return cause.hypothesis.effect in DRY and {term.index for term in cause.terms} <= kin


def _is_needed(problem: RolloutProblem, less: RolloutFit, fit: RolloutFit, gain: float, limits: Limits) -> bool:
    """Whether a model goes clearly nearer somewhere: half as far, or as near as healthy robots where with less it did not.

    ``gain`` is what was gained by the cause of which less is a part, or by the largest of all, nats.
    """
    if problem.is_near_noise(less):
        return False
    if problem.gained(less.squares, fit.squares) > _CLEAR * gain:
        return True
    is_off, left = less.usual_rad > FAR_OFF * problem.noise_rad, 1.0 - EXPLAINED
    if bool((is_off & (fit.usual_rad < left * less.usual_rad)).any()):
        return True
    healthy = limits(less)
    errors = (less.usual_rad, fit.usual_rad, healthy.usual_rad), (less.far_rad, fit.far_rad, healthy.far_for(less))
    return any(bool(((before > most) & (after < np.maximum(most, left * before))).any()) for before, after, most in errors)


def _clearest(selection: RolloutSelection, cause: Taken) -> Taken | None:
    """A cause of all joints as that of the one where its number is clearest; None for a cause of one joint."""
    if cause.hypothesis.where != ALL_JOINTS or len({term.index for term in cause.terms}) < 2:
        return None
    fit, catalogue = selection.fit, selection.problem.catalogue
    at = [i for i, term in enumerate(fit.terms) if term.key == cause.terms[0].key and term in cause.terms]
    off = np.abs(apart(fit.state, selection.problem.start, [fit.terms[i] for i in at]))
    joint = fit.terms[at[int(np.argmax(off / np.maximum(fit.errors[at], 1e-30)))]].index
    terms = tuple(term for term in cause.terms if term.index == joint)
    for hypothesis in catalogue.hypotheses:
        is_there = all(catalogue.terms[i].index == joint for i in hypothesis.terms)
        if hypothesis.effect == cause.hypothesis.effect and hypothesis.where != ALL_JOINTS and is_there:
            return Taken(hypothesis, terms, cause.gain, cause.others)
    return None
