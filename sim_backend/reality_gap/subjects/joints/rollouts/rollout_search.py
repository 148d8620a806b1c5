"""One cause after the other: what gains most beside a model, whether a robot may be so, and which cause is needed no more."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, NUMBERS
from sim_backend.reality_gap.subjects.joints.laws.forms import in_other_forms
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, PLATFORM, Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.moves import deviations
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import SHOWN, gains
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import (
    OF_NUMBER,
    Tried,
    fitted_quickly,
    fitted_wholly,
    fitted_without,
    gone_on,
    settled,
)
from sim_backend.reality_gap.subjects.joints.torques.contradictions import is_gravity, pushes, runs_into_bounds
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted

GATE = 12.0
"""Nats that a cause must gain: odds of 160 000, shared by some hundred hypotheses."""
_TRIED, _TRIED_FROM = 6, 3.0
"""So many of the best, by their linear gains in nats, are fitted."""
_SHORTER = 0.2
"""Share of a straight line's values that a fit begins with where those led astray: it promised much, and nothing was gained."""
_OF_FEW = 0.1
"""Nats of each window that a linear gain must have where windows are few: together they can tell no more."""
_WHOLLY = 2
"""So many of those are fitted once more together with everything else."""
_SETTLED_FROM = 0.2
"""Share of the best one's gain from which on they go on until they gain no more, before they are compared."""
_MOSTLY = 0.25
"""Share of its joint's error that a cause leaves which is no mend of another joint's law."""
_CLEARLY = 5.0
"""Standard errors: what is so far away is shown, however much uncertainty is left."""
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
class CauseSearch:
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
            fit, taken = found[0], (*taken, found[1])
            self.progress(f"{found[1].hypothesis.effect}, {found[1].hypothesis.where}", 1.0 - 0.7 ** len(taken))
            fit, taken = without_needless(self, fit, taken, kept)
        return fit, taken


def _best(search: CauseSearch, fit: RolloutFit, taken: Sequence[Taken], share: float) -> tuple[RolloutFit, Taken] | None:
    """What gains most of those that are possible, and the model with it; ``share`` as of :func:`_least`."""
    if id(fit) not in search.tried:
        search.tried[id(fit)] = fit, tried_beside(search, fit, taken)
    asked = {hypothesis.name for hypothesis in search.catalogue.hypotheses}
    tried = [each for each in search.tried[id(fit)][1] if each[2].name in asked]
    enough = [entry for entry in tried if entry[0] >= _least(search.problem, fit, entry, taken, share)]
    if not enough:
        return None
    return took(_single_rather_than_all(enough), tried)


def took(chosen: Tried, tried: Sequence[Tried]) -> tuple[RolloutFit, Taken]:
    """A cause with what it was chosen from, and the model that has it."""
    gain, new, hypothesis, plain = chosen
    others = [
        (own_gain + OF_NUMBER * max(0, len(terms) - len(plain)), fit_of_it, other, terms)
        for own_gain, fit_of_it, other, terms in tried
        if other.name != hypothesis.name and FITTED[other.effect].contains != hypothesis.effect
    ]
    return new, Taken(hypothesis, plain, gain, tuple(sorted(others, key=lambda other: -other[0])))


def tried_beside(search: CauseSearch, fit: RolloutFit, taken: Sequence[Taken]) -> list[Tried]:
    """What may be wrong beside what a model has, fitted, the best first."""
    problem, catalogue = search.problem, search.catalogue
    own = [term for cause in taken for term in cause.terms]
    names, tried = {cause.hypothesis.name for cause in taken}, list[Tried]()
    everywhere = {effect for effect, where in names if where == ALL_JOINTS}
    from_nats = min(_TRIED_FROM, _OF_FEW * len(problem.windows))
    for linear, hypothesis, values, errors in _distinct(gains(problem, fit, catalogue.hypotheses), names):
        if hypothesis.effect in everywhere:
            continue
        if (linear < from_nats or len(tried) >= _TRIED) and hypothesis.name not in search.proposed:
            continue
        terms = tuple(catalogue.terms[i] for i in hypothesis.terms)
        shown, along = _that_show(terms, hypothesis, values, errors)
        found = [fitted_quickly(problem, fit, own, hypothesis, shown, along)]
        if linear >= GATE and found[0][0] <= 0.0:
            found.append(fitted_quickly(problem, fit, own, hypothesis, shown, _SHORTER * along))
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
    from_nats = max(GATE, _SETTLED_FROM * max((entry[0] for entry in whole), default=0.0))
    whole = [gone_on(problem, fit, entry) if entry[0] >= from_nats else entry for entry in whole]
    whole.sort(key=lambda entry: -entry[0])
    return [each for each in whole if _is_worth_it(fit, each[1]) and _is_possible(search, taken, *each)]


def _proposed(search: CauseSearch, state: JointState, hypothesis: Hypothesis, terms: tuple[Term, ...]) -> Iterator[np.ndarray]:
    """Changes of terms to try that do not follow from a straight line: levels of a limit, and what something else has found."""
    if NUMBERS[terms[0].key].begins_at_load:
        start = search.problem.start
        yield np.array([t.probe + start.value(t.key)[t.index] - state.value(t.key)[t.index] for t in terms])
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
    search: CauseSearch,
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
    return search.fits(new.state) and may_be(search, new, causes, is_whole=is_whole)


def _least(problem: RolloutProblem, fit: RolloutFit, tried: Tried, taken: Sequence[Taken], share: float) -> float:
    """What a cause must gain beside others: a share of the largest, unless hardly anything is left or a joint is its own."""
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


def may_be(search: CauseSearch, fit: RolloutFit, taken: Sequence[Taken], *, is_whole: bool = True) -> bool:
    """Whether a robot may be so.

    A gravity of another strength is one only where hardly anything is left with it: no more than encoders or healthy robots
    leave. What is left is known once all was fitted that a healthy robot may be off by, too.
    """
    problem = search.problem
    is_any = not is_whole or search.any_gravity or leaves_little(search, fit)
    return (is_any or is_gravity(problem.gravity_m_s2, fit.state)) and stays_within(problem, fit, taken)


def leaves_little(search: CauseSearch, fit: RolloutFit) -> bool:
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


def without_needless(
    search: CauseSearch, fit: RolloutFit, taken: tuple[Taken, ...], kept: int = 0
) -> tuple[RolloutFit, tuple[Taken, ...]]:
    """Drop causes that gain nothing any more beside those that came later, but for the first ones, ``kept``."""
    problem = search.problem
    for cause in taken[kept:-1]:
        rest = tuple(other for other in taken if other is not cause)
        less = fitted_without_cause(problem, fit, taken, cause)
        if problem.gained(less.squares, fit.squares) - OF_NUMBER * len(cause.terms) < GATE and may_be(search, less, rest):
            return without_needless(search, settled(problem, less), rest, kept)
    return fit, taken


def with_best_forms(search: CauseSearch, fit: RolloutFit, taken: tuple[Taken, ...]) -> tuple[RolloutFit, tuple[Taken, ...]]:
    """Causes with laws of the forms that leave least; what is needless then goes.

    A law of another form than the robot's leaves what another cause may have made up for, and its numbers are not the robot's.
    """
    problem, before = search.problem, fit
    terms = [term for cause in taken for term in cause.terms]
    for term in terms:
        for state in list(in_other_forms(fit.state, term)):
            new = settled(problem, problem.fitted(state, terms, fit.begin))
            if problem.gained(fit.squares, new.squares) > 0.0 and may_be(search, new, taken):
                fit = new
    return (fit, taken) if fit is before else without_needless(search, fit, taken)


def fitted_without_cause(problem: RolloutProblem, fit: RolloutFit, taken: Sequence[Taken], cause: Taken) -> RolloutFit:
    """The model with all causes but one of them, fitted anew."""
    return fitted_without(problem, fit, cause.terms, [term for other in taken if other is not cause for term in other.terms])
