"""Causes that a robot needs: one without which it goes no further off than healthy robots with the others is not named.

A fit takes whatever helps. A cause that only mends what another's law leaves, or what a healthy robot may differ by, gains many
nats where noise is small, and moves windows hardly at all.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.hypotheses import ALL_JOINTS, Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.rollout_fit import FAR_OFF, RolloutFit, RolloutProblem, apart
from sim_backend.reality_gap.subjects.joints.rollout_selection import RolloutSelection, Taken, only_at, without
from sim_backend.reality_gap.subjects.joints.verdict_of_rollouts import EXPLAINED

_CLEAR = 0.2
"""Share of what a cause gained: what loses more is needed, however little further off a robot ends up without it."""

Limits = Callable[[RolloutFit], tuple[np.ndarray, np.ndarray]]
"""What usual and far windows of a healthy robot may be off, shapes (k,), rad, to compare a model with."""


def with_needed_causes(selection: RolloutSelection, limits: Limits) -> RolloutSelection:
    """A selection of which each cause gains clearly, takes away half of an error somewhere, or what no healthy robot would leave.

    Where causes are several those that gained least are asked first; one of all joints that only one of them needs is that one's.
    What is not needed stays in the extended model.

    Args:
        selection: causes and models.
        limits: of robots that have these causes and are healthy else.
    """
    largest = max((cause.gain for cause in selection.taken), default=0.0)
    for cause in sorted(selection.taken, key=lambda taken: taken.gain) if len(selection.taken) > 1 else ():
        less = without(selection, cause)
        if not _is_needed(selection.problem, less, selection.fit, largest, limits):
            rest = tuple(other for other in selection.taken if other is not cause)
            mending = (*selection.mending, cause)
            return with_needed_causes(replace(selection, fit=less, taken=rest, mending=mending), limits)
    for cause in selection.taken:
        single = _clearest(selection, cause)
        if single is None:
            continue
        terms = tuple(term for term in cause.terms if term in single[1])
        fit = only_at(selection, cause, terms)
        if not _is_needed(selection.problem, fit, selection.fit, cause.gain, limits):
            one = Taken(single[0], terms, cause.gain, cause.others)
            taken = tuple(one if other is cause else other for other in selection.taken)
            return with_needed_causes(replace(selection, fit=fit, taken=taken), limits)
    return selection


def _is_needed(problem: RolloutProblem, less: RolloutFit, fit: RolloutFit, gain: float, limits: Limits) -> bool:
    """Whether a model goes clearly nearer somewhere: half as far, or as near as healthy robots where with less it did not.

    ``gain`` is what was gained by the cause of which less is a part, or by the largest of all, nats.
    """
    if problem.is_near_noise(less):
        return False
    if problem.gained(less.squares, fit.squares) > _CLEAR * gain:
        return True
    is_off = less.usual_rad > FAR_OFF * problem.noise_rad
    if bool((is_off & (fit.usual_rad < EXPLAINED * less.usual_rad)).any()):
        return True
    limits_rad = limits(less)
    errors = zip((less.usual_rad, less.far_rad), (fit.usual_rad, fit.far_rad), limits_rad, strict=True)
    return any(bool(((before > most) & (after < np.maximum(most, EXPLAINED * before))).any()) for before, after, most in errors)


def _clearest(selection: RolloutSelection, cause: Taken) -> tuple[Hypothesis, set] | None:
    """Of a cause of all joints the one where its number is clearest, and all numbers there; None for a cause of one joint."""
    joints = sorted({term.index for term in cause.terms})
    if cause.hypothesis.where != ALL_JOINTS or len(joints) < 2:
        return None
    fit, first = selection.fit, cause.terms[0].key
    at = [i for i, term in enumerate(fit.terms) if term.key == first and term in cause.terms]
    off = np.abs(apart(fit.state, selection.problem.start, [fit.terms[i] for i in at]))
    joint = fit.terms[at[int(np.argmax(off / np.maximum(fit.errors[at], 1e-30)))]].index
    here = {term for term in cause.terms if term.index == joint}
    return next(((h, here) for h in _alone(selection.problem.catalogue, cause, joint)), None)


def _alone(catalogue: Catalogue, cause: Taken, joint: int) -> list[Hypothesis]:
    """The same effect at one joint."""
    return [
        h
        for h in catalogue.hypotheses
        if h.effect == cause.hypothesis.effect
        and h.where != ALL_JOINTS
        and all(catalogue.terms[i].index == joint for i in h.terms)
    ]
