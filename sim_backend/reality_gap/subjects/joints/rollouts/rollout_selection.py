"""Which causes make a model go where the robot went: taken and dropped by what they gain in rollouts."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, NUMBERS
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, Catalogue
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.explained import explained_at
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import (
    FAR_OFF,
    FAR_WINDOWS,
    RolloutFit,
    RolloutProblem,
    is_nearer,
)
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import (
    GATE,
    CauseSearch,
    Proposed,
    Taken,
    fitted_without_cause,
    leaves_little,
    took,
    tried_beside,
    with_best_forms,
    without_needless,
)
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import (
    OF_NUMBER,
    as_nominal,
    fitted_instead,
    fitted_without,
    settled,
)

_MENDS = 0.5
"""A cause that gains less than this share of the largest, leaving more than noise, may only mend what that one's law leaves."""
_NEARLY = 2.0
"""Times what healthy robots are off: what leaves more is asked for a gravity of another strength, which may leave no more.

A mass or a torque constant is asked for it, too: it looks like that.
"""
_MANY = 3
"""So many causes are asked for it, too: with fewer beside it, and no joint further off, gravity is the plainer answer."""
_AS_FAR = 1.1
"""Times as far off a joint may be with fewer causes, gravity among them: bearings that give make up for a part of the others."""
_LITTLE = 0.02
"""Share of an error that causes may leave to be all there are: laws of another shape than the robot's leave more."""
_MOST, _MOST_MENDING = 6, 2
_BRANCHES = 2
"""So many other causes are begun with where something is left."""


@dataclass(frozen=True)
class RolloutSelection:
    """What rollouts came to.

    Attributes:
        problem: windows of recordings.
        nominal: the model without any cause, within its tolerances.
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
    proposed: Proposed = MappingProxyType({}),
    healthy_rad: np.ndarray | float = 0.0,
    enough_rad: np.ndarray | float = 0.0,
    is_healthy: Callable[[RolloutFit], bool] = lambda _: False,
) -> RolloutSelection:
    """Take the cause that gains most, fit everything anew, drop what is needed no more, until nothing gains.

    Where the causes end up nearer with a controller that computes in another way, it is all done anew with that one.

    Args:
        problem: windows of recordings.
        catalogue: what may be wrong.
        fits: whether nothing measured rules a model out.
        progress: told what is done, and which share.
        proposed: effects at places that are tried whatever their linear gains, from the values that are given, too.
        healthy_rad: what usual windows of a robot that nothing is wrong with are off once it was fitted within its tolerances,
            shape (k,), where that is known.
        enough_rad: what usual windows may be off for anybody, shape (k,): a gravity of another strength that leaves no more is
            the answer rather than causes that leave more.
        is_healthy: whether a model leaves no more than robots that nothing is wrong with: then the order in which causes are
            taken is doubted only if they take what they must to be named there.
    """
    search = CauseSearch(problem, catalogue, fits, progress, proposed, healthy_rad)
    found = _selected(search, enough_rad, is_healthy)
    otherwise = problem.otherwise()
    if otherwise is None or not any(is_nearer(fit, found.fit) for fit in _with_other_loop(otherwise, found)):
        return found
    again = _selected(replace(search, problem=otherwise, tried={}), enough_rad, is_healthy)
    return again if is_nearer(again.fit, found.fit) else found


def _with_other_loop(otherwise: RolloutProblem, found: RolloutSelection) -> Iterator[RolloutFit]:
    """What was found with a controller that computes in another way: all causes, then what came next to the first of them.

    One cause may make up for the wrong way of computing, so that only another shows which way it is.
    """
    if found.taken:
        terms = [term for cause in found.taken for term in cause.terms]
        yield otherwise.fitted(found.fit.state, terms, found.fit.begin)
        for _, fit, _, own in found.taken[0].others[:_BRANCHES]:
            yield otherwise.fitted(fit.state, own, fit.begin)


def _selected(search: CauseSearch, enough_rad: np.ndarray | float, is_healthy: Callable[[RolloutFit], bool]) -> RolloutSelection:
    problem = search.problem
    nominal = settled(problem, problem.fitted(problem.start, ()))
    found = _path(search, nominal, nominal, ())
    is_doubted = explained_at(nominal, found.fit, None).any() or not is_healthy(nominal)
    for other in _other_paths(search, nominal, found) if is_doubted else ():
        found = other if _is_better(problem, other, found) else found
    nearly = replace(search, healthy_rad=_NEARLY * np.asarray(search.healthy_rad))
    is_like = any(FITTED[cause.hypothesis.effect].scales_everything for cause in found.taken)
    is_plain = leaves_little(nearly, found.fit) and len(found.taken) < _MANY and not is_like
    other = None if is_plain else _with_other_gravity(search, nominal)
    if other is None or not _gains_more(other, found):
        return found
    is_as_near = bool((other.fit.usual_rad <= _AS_FAR * found.fit.usual_rad).all())
    is_plainer = len(other.taken) < len(found.taken) and is_as_near
    is_near = leaves_little(nearly, other.fit) or bool((other.fit.usual_rad < enough_rad).all())
    return other if is_plainer or is_near else found


def _names(selection: RolloutSelection) -> set[tuple[str, str]]:
    """Effects at places that were taken."""
    return {cause.hypothesis.name for cause in selection.taken}


def _not_asking(search: CauseSearch, names: set[tuple[str, str]]) -> CauseSearch:
    """A search that asks for some effects neither at these places nor at all joints: it would only come back to them."""
    effects = {effect for effect, _ in names}
    asked = tuple(
        h for h in search.catalogue.hypotheses if h.name not in names and (h.where != ALL_JOINTS or h.effect not in effects)
    )
    return replace(search, catalogue=replace(search.catalogue, hypotheses=asked), tried={})


def _with_other_gravity(search: CauseSearch, nominal: RolloutFit) -> RolloutSelection | None:
    """What a search comes to that begins with a gravity of another strength; None where that gains nothing.

    Whether it is possible depends on what is left with it, which beside other causes is known last. It is tried whatever a
    straight line says: none leads to it from a model that goes elsewhere altogether.
    """
    alone = tuple(h for h in search.catalogue.hypotheses if FITTED[h.effect].contains)
    lenient = replace(search, any_gravity=True, tried={}, proposed={h.name: {} for h in alone} | dict(search.proposed))
    tried = tried_beside(replace(lenient, catalogue=replace(search.catalogue, hypotheses=alone)), nominal, ())
    if not tried or tried[0][0] < GATE:
        return None
    fit, first = took(tried[0], tried)
    return _path(lenient, nominal, fit, (first,))


def _path(search: CauseSearch, nominal: RolloutFit, fit: RolloutFit, taken: tuple[Taken, ...]) -> RolloutSelection:
    """What a search comes to that goes on from a model with some causes.

    What only mends what a law leaves is no cause, unless with it hardly anything is left, or no more than healthy robots leave
    where it was more without it: then all laws are those of the robot.
    """
    problem = search.problem
    fit, taken = search.extended(fit, taken, _MENDS, _MOST)
    if not taken:
        return RolloutSelection(problem, nominal, fit, (), fit)
    fit, taken = with_best_forms(search, fit, taken)
    mends = replace(search, catalogue=_without_limits(search.catalogue))
    extended, every = mends.extended(fit, taken, 0.0, len(taken) + _MOST_MENDING, kept=len(taken))
    is_whole = _leaves_nothing(problem, nominal, extended) or (leaves_little(search, extended) and not leaves_little(search, fit))
    if len(every) > len(taken) and is_whole:
        fit, taken = without_needless(search, extended, every)
        extended, every = fit, taken
    mending = every[len(taken) :]
    fit = settled(problem, fit)
    extended = settled(problem, extended) if mending else fit
    needed = tuple(replace(cause, terms=_needed(problem, fit, cause)) for cause in taken)
    return RolloutSelection(problem, nominal, fit, needed, extended, mending)


def _other_paths(search: CauseSearch, nominal: RolloutFit, found: RolloutSelection) -> Iterator[RolloutSelection]:
    """What searches come to that begin with other causes; one that comes back to those that were found goes on without them."""
    names = _names(found)
    for fit, first in _other_firsts(search, nominal, found):
        other = _path(search, nominal, fit, (first,))
        yield other
        if first.hypothesis.name not in names and names <= _names(other):
            yield _path(_not_asking(search, names), nominal, fit, (first,))


def _other_firsts(search: CauseSearch, nominal: RolloutFit, found: RolloutSelection) -> list[tuple[RolloutFit, Taken]]:
    """Causes to begin with instead of the first, which may have stood for two: one joint's instead of all joints', and others.

    Others only where something is left. The order in which causes are found must not decide which they are.
    """
    if id(nominal) not in search.tried or not found.taken:
        return []
    tried = search.tried[id(nominal)][1]
    enough = [each for each in tried if each[0] >= GATE]
    names = _names(found)
    of_all = {effect for effect, where in names if where == ALL_JOINTS}
    single = [each for each in enough if each[2].effect in of_all and each[2].where != ALL_JOINTS][:1]
    is_left = not search.problem.is_near_noise(found.fit)
    others = [each for each in enough if each[2].name not in names and each not in single][:_BRANCHES] if is_left else []
    return [took(each, tried) for each in (*single, *others)]


def _leaves_nothing(problem: RolloutProblem, nominal: RolloutFit, fit: RolloutFit) -> bool:
    """Whether hardly anything is left, of usual windows and of far ones: encoders' noise, or a small share of what there was."""
    near_rad, far_rad = (FAR_OFF * by * problem.noise_rad for by in (1.0, FAR_WINDOWS))
    little = (fit.usual_rad < np.maximum(near_rad, _LITTLE * nominal.usual_rad)).all()
    return bool(little and (fit.far_rad < np.maximum(far_rad, _LITTLE * nominal.far_rad)).all())


def _is_better(problem: RolloutProblem, one: RolloutSelection, other: RolloutSelection) -> bool:
    """Whether causes leave less than others by more than their numbers are worth, and hardly anything, or are no more numbers.

    Those have to gain as much as a number would: fits end where they gain less.
    """
    if _numbers(one) <= _numbers(other) and _ahead(one, other) > OF_NUMBER:
        return True
    return _leaves_nothing(problem, one.nominal, one.fit) and _gains_more(one, other)


def _gains_more(one: RolloutSelection, other: RolloutSelection) -> bool:
    """Whether causes leave less than others by more than their numbers are worth."""
    return _ahead(one, other) > 0.0


def _ahead(one: RolloutSelection, other: RolloutSelection) -> float:
    """What causes gain over others, less what they have more of numbers, nats."""
    return one.problem.gained(other.fit.squares, one.fit.squares) - OF_NUMBER * (_numbers(one) - _numbers(other))


def _numbers(selection: RolloutSelection) -> int:
    """Of all causes that were taken."""
    return sum(len(cause.terms) for cause in selection.taken)


def _without_limits(catalogue: Catalogue) -> Catalogue:
    """What may mend a law without being a cause: a limit would cut what other motions need."""
    return catalogue.without([number.key.partition(".")[0] for number in NUMBERS.values() if number.begins_at_load])


def _needed(problem: RolloutProblem, fit: RolloutFit, cause: Taken) -> tuple[Term, ...]:
    """Those of a cause's numbers without which windows end up further off, the others as they are."""
    gains = []
    for term in cause.terms:
        without = problem.squares_of(as_nominal(problem, fit.state, (term,)), fit.begin)
        gains.append(problem.gained(without, fit.squares))
    return tuple(t for t, gain in zip(cause.terms, gains, strict=True) if gain > OF_NUMBER) or cause.terms


def without(selection: RolloutSelection, cause: Taken) -> RolloutFit:
    """The model with all causes but one of them, fitted anew until that gains no more."""
    return settled(selection.problem, fitted_without_cause(selection.problem, selection.fit, selection.taken, cause))


def only_at(selection: RolloutSelection, cause: Taken, terms: Sequence[Term]) -> RolloutFit:
    """The model with a part of one of its causes, fitted anew until that gains no more."""
    gone = [term for term in cause.terms if term not in terms]
    others = [term for other in selection.taken if other is not cause for term in other.terms]
    return settled(selection.problem, fitted_without(selection.problem, selection.fit, gone, [*others, *terms]))


def instead(selection: RolloutSelection, cause: Taken, alone: RolloutFit, terms: Sequence[Term]) -> RolloutFit:
    """The model with another's terms in the place of one of its causes, fitted anew from where they are ``alone``."""
    others = [term for other in selection.taken if other is not cause for term in other.terms]
    return fitted_instead(selection.problem, selection.fit, cause.terms, others, alone, terms)
