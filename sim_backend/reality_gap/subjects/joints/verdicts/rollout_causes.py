"""Causes with values and intervals, of the numbers of a model that was fitted in rollouts."""

from collections.abc import Sequence
from dataclasses import replace

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SHAPES
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import FittedValue, at_usual_factor, other_form, seen_beside
from sim_backend.reality_gap.subjects.joints.laws.heating import is_in_balance, is_usual
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, own_share
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import TOLERATED
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Taken
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.verdicts.causes import index_of
from sim_backend.reality_gap.verdict import Cause

_TRIFLE = 0.05
"""Of the largest number of a cause at all joints: a joint with less has none, unless that is more than its model may be off."""


def extended_causes(study: JointStudy, selection: RolloutSelection) -> list[Cause]:
    """Numbers of the model that goes where the robot went best: the causes' own in it, and what mends the rest."""
    if not selection.mending:
        return []
    every = (*selection.taken, *selection.mending)
    return [cause for taken in every for cause in causes_of(study, selection.extended, taken)]


def products_of(study: JointStudy, causes: Sequence[Cause]) -> list[str]:
    """Sentences on numbers of which motions show only the product with another one, which is told as it is usual.

    Where the other one was measured or stated, both are known, unless a recorded temperature hardly changes.
    """
    said = list[str]()
    for cause in causes:
        number = NUMBERS.get(f"{cause.effect}.{cause.parameter}")
        if number is None or number.product_with is None:
            continue
        key, joint = number.product_with[0], index_of(study.problem.names, number.product_with[0], cause.where)
        if is_usual(study.start, key, joint):
            other = key.partition(".")[2]
            said.append(f"{cause.parameter} and {other} of {cause.where} apart: motions show only their product")
        elif is_in_balance(study.start, joint):
            said.append(f"how the motor of {cause.where} gets warm: its temperature hardly changes, and counts as in balance")
    return list(dict.fromkeys(said))


def covering(cause: Cause, extended: Sequence[Cause]) -> Cause:
    """A cause whose interval holds what its number comes to beside what mends the rest: which of both is so nobody knows."""
    same = [e.value for e in extended if (e.effect, e.parameter, e.where) == (cause.effect, cause.parameter, cause.where)]
    edges = [*cause.interval_90, *same]
    return replace(cause, interval_90=(min(edges), max(edges)))


def causes_of(study: JointStudy, fit: RolloutFit, taken: Taken) -> list[Cause]:
    """One cause for each number of a fit that is away from the nominal model beyond its interval.

    What only says how a number looks is told where that number is.
    """
    errors = {(t.key, t.index): float(e) for t, e in zip(fit.terms, fit.errors, strict=True)}
    found, sizes, clear = [], dict[int, float](), set[int]()
    for term in sorted(taken.terms, key=lambda term: term.key in SHAPES):
        parameter, value = PARAMETERS[term.key], float(fit.state.value(term.key)[term.index])
        start = study.problem_start(term.key, term.index)
        off, half = value - start, half_interval(term.key, value, start, errors[term.key, term.index])
        where = taken.hypothesis.where
        if parameter.scope in (Scope.JOINT, Scope.VECTOR):
            where = study.problem.names[term.index] if parameter.scope is Scope.JOINT else "xyz"[term.index]
        if term.index in clear if term.key in SHAPES else abs(off) > half:
            clear.add(term.index)
            told = at_usual_factor(study.start, fit.state, FittedValue(term.key, term.index, value, half))
            beside = seen_beside(study.start, term) if term.key == taken.terms[0].key else []
            for each in [*told, *beside, *other_form(study.start, fit.state, term)]:
                of, interval = PARAMETERS[each.key], (each.value - each.error, each.value + each.error)
                found.append((term.index, Cause(taken.hypothesis.effect, of.name, where, each.value, of.unit, interval)))
            if term.key == taken.terms[0].key:
                sizes[term.index] = abs(off)
    if taken.hypothesis.where != ALL_JOINTS:
        return [cause for _, cause in found]
    least = {index: least_of(study, taken.terms[0].key, index, max(sizes.values())) for index in sizes}
    return [cause for index, cause in found if index not in sizes or sizes[index] > least[index]]


def least_of(study: JointStudy, key: str, index: int, largest: float) -> float:
    """What a joint must have of a cause at all joints to have it: more than a trifle of the largest, or than is tolerated."""
    robot = study.robot
    tolerated = TOLERATED * own_share(robot.tolerance, key, index, study.start) if isinstance(robot, UnknownRobot) else 0.0
    return min(_TRIFLE * largest, tolerated) if tolerated > 0.0 else _TRIFLE * largest
