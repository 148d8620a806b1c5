"""Which causes make a model go where the robot went: taken and dropped by what they gain in rollouts."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, NUMBERS
from sim_backend.reality_gap.subjects.joints.contradictions import is_gravity, pushes, runs_into_bounds
from sim_backend.reality_gap.subjects.joints.hypotheses import ALL_JOINTS, PLATFORM, Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.look import Accepted
from sim_backend.reality_gap.subjects.joints.moves import deviations
from sim_backend.reality_gap.subjects.joints.rollout_fit import FAR_OFF, FAR_WINDOWS, RolloutFit, RolloutProblem, is_nearer
from sim_backend.reality_gap.subjects.joints.rollout_questions import SHOWN, gains
from sim_backend.reality_gap.subjects.joints.rollout_trials import (
    OF_NUMBER,
    Tried,
    as_nominal,
    fitted_instead,
    fitted_quickly,
    fitted_wholly,
    fitted_without,
)
from sim_backend.reality_gap.subjects.joints.state import JointState, Term

GATE = 12.0
"""Nats that a cause must gain: odds of 160 000, shared by some hundred hypotheses."""
_TRIED, _TRIED_FROM = 6, 3.0
"""So many of the best, by their linear gains in nats, are fitted."""
_WHOLLY = 2
"""So many of those are fitted once more together with everything else."""
_MENDS = 0.5
"""A cause that gains less than this share of the largest, leaving more than noise, may only mend what that one's law leaves."""
_MOSTLY = 0.25
"""Share of its joint's error that a cause leaves which is no mend of another joint's law."""
_NEARLY = 4.0
"""Times what healthy robots are off that a gravity of another strength may leave beside other causes."""
_LITTLE = 0.02
"""Share of an error that causes may leave to be all there are: laws of another shape than the robot's leave more."""
_CLEARLY = 5.0
"""Standard errors: what is so far away is shown, however much uncertainty is left."""
_MOST, _MOST_MENDING = 6, 2
_BRANCHES = 2
"""So many other causes are begun with where something is left."""
_LEAST_REDUCTION = 0.03
"""Share of a joint's error that a cause must take away at one joint."""


Proposed = Mapping[tuple[str, str], Mapping[tuple[str, int], float]]
"""Values by number and index of effects at places; none where only the effect is proposed."""


@dataclass(frozen=True)
class Taken:
    """A cause in the model: an effect at a place with its terms, what it gained when it was taken, and what others would have.

    Others are compared as if they had no more numbers: what fits as well with three numbers as another with one is as possible.
    """

    hypothesis: Hypothesis
    terms: tuple[Term, ...]
    gain: float
    others: tuple[Tried, ...]


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
    """
    found = _selected(problem, catalogue, fits, progress, proposed, healthy_rad)
    otherwise = problem.otherwise()
    if otherwise is None or not any(is_nearer(fit, found.fit) for fit in _with_other_loop(otherwise, found)):
        return found
    again = _selected(otherwise, catalogue, fits, progress, proposed, healthy_rad)
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


def _selected(
    problem: RolloutProblem,
    catalogue: Catalogue,
    fits: Callable[[JointState], bool],
    progress: Callable[[str, float], None],
    proposed: Proposed,
    healthy_rad: np.ndarray | float,
) -> RolloutSelection:
    search = _Search(problem, catalogue, fits, progress, proposed, healthy_rad)
    nominal = problem.fitted(problem.start, ())
    found = _path(search, nominal, nominal, ())
    for fit, first in _other_firsts(search, nominal, found):
        other = _path(search, nominal, fit, (first,))
        found = other if _is_better(problem, other, found) else found
    other = _with_other_gravity(search, nominal, found)
    if other is None or not _gains_more(other, found):
        return found
    nearly = replace(search, healthy_rad=_NEARLY * np.asarray(search.healthy_rad))
    return other if _leaves_little(nearly, other.fit) else found


def _with_other_gravity(search: "_Search", nominal: RolloutFit, found: RolloutSelection) -> RolloutSelection | None:
    """What a search comes to that begins with a gravity of another strength, where something is left.

    That is possible only where hardly anything is left with it, which beside other causes is known last.
    """
    alone = tuple(h for h in search.catalogue.hypotheses if FITTED[h.effect].contains)
    if search.problem.is_near_noise(found.fit) or not alone:
        return None
    lenient = replace(search, any_gravity=True, tried={})
    tried = _tried_beside(replace(lenient, catalogue=replace(search.catalogue, hypotheses=alone)), nominal, ())
    if not tried or tried[0][0] < GATE:
        return None
    fit, first = _took(tried[0], tried)
    return _path(lenient, nominal, fit, (first,))


def _path(search: "_Search", nominal: RolloutFit, fit: RolloutFit, taken: tuple[Taken, ...]) -> RolloutSelection:
    """What a search comes to that goes on from a model with some causes.

    What only mends what a law leaves is no cause, unless with it hardly anything is left: then all laws are those of the robot.
    """
    problem = search.problem
    fit, taken = search.extended(fit, taken, _MENDS, _MOST)
    if not taken:
        return RolloutSelection(problem, nominal, fit, (), fit)
    mends = replace(search, catalogue=_without_limits(search.catalogue))
    extended, every = mends.extended(fit, taken, 0.0, len(taken) + _MOST_MENDING, kept=len(taken))
    if len(every) > len(taken) and _leaves_nothing(problem, nominal, extended):
        fit, taken = _without_needless(search, extended, every)
        extended, every = fit, taken
    mending = every[len(taken) :]
    return RolloutSelection(
        problem, nominal, fit, tuple(replace(c, terms=_needed(problem, fit, c)) for c in taken), extended, mending
    )


def _other_firsts(search: "_Search", nominal: RolloutFit, found: RolloutSelection) -> list[tuple[RolloutFit, Taken]]:
    """Causes to begin with instead of the first, which may have stood for two: one joint's instead of all joints', and others.

    Others only where something is left. The order in which causes are found must not decide which they are.
    """
    if id(nominal) not in search.tried or not found.taken:
        return []
    tried = search.tried[id(nominal)][1]
    enough = [each for each in tried if each[0] >= GATE]
    names = {cause.hypothesis.name for cause in found.taken}
    of_all = {effect for effect, where in names if where == ALL_JOINTS}
    single = [each for each in enough if each[2].effect in of_all and each[2].where != ALL_JOINTS][:1]
    is_left = not search.problem.is_near_noise(found.fit)
    others = [each for each in enough if each[2].name not in names and each not in single][:_BRANCHES] if is_left else []
    return [_took(each, tried) for each in (*single, *others)]


def _leaves_nothing(problem: RolloutProblem, nominal: RolloutFit, fit: RolloutFit) -> bool:
    """Whether hardly anything is left, of usual windows and of far ones: encoders' noise, or a small share of what there was."""
    near_rad, far_rad = (FAR_OFF * by * problem.noise_rad for by in (1.0, FAR_WINDOWS))
    little = (fit.usual_rad < np.maximum(near_rad, _LITTLE * nominal.usual_rad)).all()
    return bool(little and (fit.far_rad < np.maximum(far_rad, _LITTLE * nominal.far_rad)).all())


def _is_better(problem: RolloutProblem, one: RolloutSelection, other: RolloutSelection) -> bool:
    """Whether causes leave hardly anything, and less than others by more than their numbers are worth."""
    return _leaves_nothing(problem, one.nominal, one.fit) and _gains_more(one, other)


def _gains_more(one: RolloutSelection, other: RolloutSelection) -> bool:
    """Whether causes leave less than others by more than their numbers are worth."""
    numbers = [sum(len(cause.terms) for cause in each.taken) for each in (one, other)]
    return one.problem.gained(other.fit.squares, one.fit.squares) > OF_NUMBER * (numbers[0] - numbers[1])


def _without_limits(catalogue: Catalogue) -> Catalogue:
    """What may mend a law without being a cause: a limit would cut what other motions need."""
    return catalogue.without([number.key.partition(".")[0] for number in NUMBERS.values() if number.begins_at_load])


@dataclass(frozen=True)
class _Search:
    """Causes are taken one by one; fields are the arguments of :func:`select_by_rollouts`."""

    problem: RolloutProblem
    catalogue: Catalogue
    fits: Callable[[JointState], bool]
    progress: Callable[[str, float], None]
    proposed: Proposed
    healthy_rad: np.ndarray | float
    any_gravity: bool = False
    """Whether gravity may be of another strength before it is known how much is left with it."""
    tried: "dict[int, tuple[RolloutFit, list[Tried]]]" = field(default_factory=dict)
    """What was fitted beside a model, by its identity."""

    def extended(
        self, fit: RolloutFit, taken: tuple[Taken, ...], share: float, most: int, kept: int = 0
    ) -> tuple[RolloutFit, tuple[Taken, ...]]:
        """A model with more causes, at most so many, each worth a share of the largest; the first ones, ``kept``, stay."""
        while len(taken) < most and not self.problem.is_near_noise(fit):
            found = _best(self, fit, taken, share)
            if found is None:
                break
            fit, is_whole = found[0], bool(taken)
            taken = (*taken, found[1])
            if not is_whole:
                fit = self.problem.fitted(fit.state, found[1].terms, fit.begin)
            self.progress(f"{found[1].hypothesis.effect}, {found[1].hypothesis.where}", 1.0 - 0.7 ** len(taken))
            fit, taken = _without_needless(self, fit, taken, kept)
        return fit, taken


def _best(search: _Search, fit: RolloutFit, taken: Sequence[Taken], share: float) -> tuple[RolloutFit, Taken] | None:
    """What gains most of those that are possible, and the model with it; ``share`` as of :func:`_least`."""
    if id(fit) not in search.tried:
        search.tried[id(fit)] = fit, _tried_beside(search, fit, taken)
    asked = {hypothesis.effect for hypothesis in search.catalogue.hypotheses}
    tried = [each for each in search.tried[id(fit)][1] if each[2].effect in asked]
    enough = [entry for entry in tried if entry[0] >= _least(search.problem, fit, entry, taken, share)]
    if not enough:
        return None
    return _took(_single_rather_than_all(enough), tried)


def _took(chosen: Tried, tried: Sequence[Tried]) -> tuple[RolloutFit, Taken]:
    """A cause with what it was chosen from, and the model that has it."""
    gain, new, hypothesis, plain = chosen
    others = [
        (own_gain + OF_NUMBER * max(0, len(terms) - len(plain)), fit_of_it, other, terms)
        for own_gain, fit_of_it, other, terms in tried
        if other.name != hypothesis.name and FITTED[other.effect].contains != hypothesis.effect
    ]
    return new, Taken(hypothesis, plain, gain, tuple(sorted(others, key=lambda other: -other[0])))


def _tried_beside(search: _Search, fit: RolloutFit, taken: Sequence[Taken]) -> list[Tried]:
    """What may be wrong beside what a model has, fitted, the best first."""
    problem, catalogue = search.problem, search.catalogue
    own = [term for cause in taken for term in cause.terms]
    names, tried = {cause.hypothesis.name for cause in taken}, list[Tried]()
    everywhere = {effect for effect, where in names if where == ALL_JOINTS}
    for linear, hypothesis, values, errors in _distinct(gains(problem, fit, catalogue.hypotheses), names):
        if hypothesis.effect in everywhere:
            continue
        if (linear < _TRIED_FROM or len(tried) >= _TRIED) and hypothesis.name not in search.proposed:
            continue
        terms = tuple(catalogue.terms[i] for i in hypothesis.terms)
        found = [fitted_quickly(problem, fit, own, hypothesis, *_that_show(terms, hypothesis, values, errors))]
        found += [
            fitted_quickly(problem, fit, own, hypothesis, terms, begin, is_proposed=True)
            for begin in _proposed(search, fit.state, hypothesis, terms)
        ]
        best_of_them = max(found, key=lambda entry: entry[0])
        if _is_possible(search, taken, *best_of_them, is_whole=False):
            tried.append(best_of_them)
    best = sorted((entry for entry in tried if _is_worth_it(fit, entry[1])), key=lambda entry: -entry[0])[:_WHOLLY]
    # with all that a healthy robot may be off by, as the model had it: also those that are seen only then, by their linear gains
    best += [entry for entry in tried[:_WHOLLY] if not any(entry is other for other in best)]
    whole = [fitted_wholly(problem, fit, own, *entry[1:]) for entry in best]
    whole.sort(key=lambda entry: -entry[0])
    return [each for each in whole if _is_worth_it(fit, each[1]) and _is_possible(search, taken, *each)]


def _proposed(search: _Search, state: JointState, hypothesis: Hypothesis, terms: tuple[Term, ...]) -> Iterator[np.ndarray]:
    """Changes of terms to try that do not follow from a straight line: levels of a limit, and what something else has found."""
    if NUMBERS[terms[0].key].begins_at_load:
        yield np.array([term.probe for term in terms])
    if given := search.proposed.get(hypothesis.name):
        yield deviations(state.with_values(given), state, terms)


def _that_show(
    terms: Sequence[Term], hypothesis: Hypothesis, values: np.ndarray, errors: np.ndarray
) -> tuple[tuple[Term, ...], np.ndarray]:
    """Of what the whole robot stands on, the directions that windows show: along the others a fit would only wander."""
    shown = (errors < SHOWN * np.array(hypothesis.scales)) | (np.abs(values) > _CLEARLY * errors)
    if hypothesis.where != PLATFORM or not shown.any():
        return tuple(terms), values
    return tuple(term for term, is_shown in zip(terms, shown, strict=True) if is_shown), values[shown]


def _is_possible(
    search: _Search,
    taken: Sequence[Taken],
    gain: float,
    new: RolloutFit,
    hypothesis: Hypothesis,
    plain: tuple[Term, ...],
    *,
    is_whole: bool = True,
) -> bool:
    """Whether a model is one that a robot may have, and contradicts nothing that was measured."""
    causes = [*taken, Taken(hypothesis, plain, gain, ())]
    return search.fits(new.state) and _may_be(search, new, causes, is_whole=is_whole)


def _needed(problem: RolloutProblem, fit: RolloutFit, cause: Taken) -> tuple[Term, ...]:
    """Those of a cause's numbers without which windows end up further off, the others as they are."""
    gains = []
    for term in cause.terms:
        without = problem.squares_of(as_nominal(problem, fit.state, (term,)), fit.begin)
        gains.append(problem.gained(without, fit.squares))
    return tuple(t for t, gain in zip(cause.terms, gains, strict=True) if gain > OF_NUMBER) or cause.terms


def _least(problem: RolloutProblem, fit: RolloutFit, tried: Tried, taken: Sequence[Taken], share: float) -> float:
    """What a cause must gain beside others: a share of the largest, unless hardly anything is left or it has a joint of its own."""
    if not taken or problem.is_near_noise(tried[1]) or _explains_a_joint(problem, fit, tried, taken):
        return GATE
    return max(GATE, share * max(cause.gain for cause in taken))


def _explains_a_joint(problem: RolloutProblem, fit: RolloutFit, tried: Tried, taken: Sequence[Taken]) -> bool:
    """Whether a cause takes away most of the error of its joint, at which there is no other: it mends no other's law."""
    _, new, hypothesis, terms = tried
    joints = {term.index for term in terms}
    if hypothesis.where in (ALL_JOINTS, PLATFORM) or joints & {term.index for cause in taken for term in cause.terms}:
        return False
    (joint,) = joints
    is_off = fit.usual_rad[joint] > FAR_OFF * problem.noise_rad[joint]
    return bool(is_off and new.usual_rad[joint] < _MOSTLY * fit.usual_rad[joint])


def _distinct(
    found: Sequence[tuple[float, Hypothesis, np.ndarray, np.ndarray]], taken: set[tuple[str, str]]
) -> list[tuple[float, Hypothesis, np.ndarray, np.ndarray]]:
    """The best of each effect and place that is not taken."""
    best: dict[tuple[str, str], tuple[float, Hypothesis, np.ndarray, np.ndarray]] = {}
    for each in found:
        if each[1].name not in taken:
            best.setdefault(each[1].name, each)
    return list(best.values())


def _single_rather_than_all(
    tried: Sequence[Tried],
) -> Tried:
    """All joints together contain what a single one is."""
    first = tried[0]
    if first[2].where != ALL_JOINTS:
        return first
    enough = first[0] - max(10.0, 0.05 * first[0])
    return next((entry for entry in tried if entry[2].where != ALL_JOINTS and entry[0] >= enough), first)


def _may_be(search: _Search, fit: RolloutFit, taken: Sequence[Taken], *, is_whole: bool = True) -> bool:
    """Whether a robot may be so.

    A gravity of another strength is one only where hardly anything is left with it: no more than encoders or healthy robots
    leave. What is left is known once all was fitted that a healthy robot may be off by, too.
    """
    problem = search.problem
    is_any = not is_whole or search.any_gravity or _leaves_little(search, fit)
    return (is_any or is_gravity(problem.gravity_m_s2, fit.state)) and stays_within(problem, fit, taken)


def _leaves_little(search: _Search, fit: RolloutFit) -> bool:
    """Whether usual windows end up no further off than encoders' noise or healthy robots make them."""
    return search.problem.is_near_noise(fit) or bool((fit.usual_rad < search.healthy_rad).all())


def stays_within(problem: RolloutProblem, fit: RolloutFit, taken: Sequence[Taken]) -> bool:
    """Whether no friction pushes, and no number of a cause runs into the end of what the catalogue allows."""
    accepted = [Accepted(c.hypothesis.effect, c.hypothesis.where, c.terms, c.gain) for c in taken]
    return not pushes(fit.state) and not runs_into_bounds(fit.state, problem.start, accepted)


def _is_worth_it(before: RolloutFit, after: RolloutFit) -> bool:
    """Whether windows of some joint end up less far off by a share, usual ones or the far ones."""
    kept = 1.0 - _LEAST_REDUCTION
    with np.errstate(invalid="ignore"):
        found = [after.usual_rad < kept * before.usual_rad, after.far_rad < kept * before.far_rad]
    return bool(np.any(found))


def _without_needless(
    search: _Search, fit: RolloutFit, taken: tuple[Taken, ...], kept: int = 0
) -> tuple[RolloutFit, tuple[Taken, ...]]:
    """Drop causes that gain nothing any more beside those that came later, but for the first ones, ``kept``."""
    problem = search.problem
    for cause in taken[kept:-1]:
        rest = tuple(other for other in taken if other is not cause)
        less = _without(problem, fit, taken, cause)
        if problem.gained(less.squares, fit.squares) - OF_NUMBER * len(cause.terms) < GATE and _may_be(search, less, rest):
            return _without_needless(search, less, rest, kept)
    return fit, taken


def without(selection: RolloutSelection, cause: Taken) -> RolloutFit:
    """The model with all causes but one of them, fitted anew."""
    return _without(selection.problem, selection.fit, selection.taken, cause)


def only_at(selection: RolloutSelection, cause: Taken, terms: Sequence[Term]) -> RolloutFit:
    """The model with a part of one of its causes, fitted anew."""
    gone = [term for term in cause.terms if term not in terms]
    others = [term for other in selection.taken if other is not cause for term in other.terms]
    return fitted_without(selection.problem, selection.fit, gone, [*others, *terms])


def instead(selection: RolloutSelection, cause: Taken, alone: RolloutFit, terms: Sequence[Term]) -> RolloutFit:
    """The model with another's terms in the place of one of its causes, fitted anew from where they are ``alone``."""
    others = [term for other in selection.taken if other is not cause for term in other.terms]
    return fitted_instead(selection.problem, selection.fit, cause.terms, others, alone, terms)


def _without(problem: RolloutProblem, fit: RolloutFit, taken: Sequence[Taken], cause: Taken) -> RolloutFit:
    return fitted_without(problem, fit, cause.terms, [term for other in taken if other is not cause for term in other.terms])
