"""The accepted effects as causes: each number with its place and an interval."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.healthy import detection_limit
from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS, SCALES
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.knowledge.value_errors import STANDSTILL_SPEED, UsualErrors, is_telling, likeliest, usual_errors
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import FittedValue, fitted_values
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted
from sim_backend.reality_gap.verdict import Cause


def causes_of(study: JointStudy, accepted: Accepted) -> list[Cause]:
    """One cause for each number of an effect that is away from absent.

    Intervals cover the noise of the data and a usual imperfection of the laws, and where a robot differs everywhere also how far
    values are usually off there.
    """
    kept = _by_own_noise(study, accepted)
    if not study.is_of_many:
        return kept
    widened = [_widened(study, cause) for cause in kept]
    clear = {cause.where for cause in widened if f"{cause.effect}.{cause.parameter}" in SCALES and is_clear(study, cause)}
    return [cause for cause in widened if f"{cause.effect}.{cause.parameter}" in SCALES or cause.where in clear]


def _by_own_noise(study: JointStudy, accepted: Accepted) -> list[Cause]:
    """The causes with intervals as if nothing else were wrong."""
    errors, found = study.fit.errors[(accepted.effect, accepted.where)], []
    for fitted in fitted_values(study.start, study.fit.state, accepted.terms, errors):
        parameter = PARAMETERS[fitted.key]
        value, start = fitted.value, study.problem_start(fitted.key, fitted.index)
        # a number that goes with another one was not estimated, and has no error
        half = 0.0 if fitted.error == 0.0 else half_interval(fitted.key, value, start, fitted.error)
        where = place_of(study.problem.names, fitted, accepted.where)
        found.append(Cause(accepted.effect, parameter.name, where, value, parameter.unit, (value - half, value + half)))
    return _that_matter(study, accepted, found)


def place_of(names: Sequence[str], fitted: FittedValue, where: str) -> str:
    """Name of the place that a number belongs to: its joint, its axis, or that of the hypothesis."""
    scope = PARAMETERS[fitted.key].scope
    return names[fitted.index] if scope is Scope.JOINT else "xyz"[fitted.index] if scope is Scope.VECTOR else where


def _widened(study: JointStudy, cause: Cause) -> Cause:
    """With what values are usually off beside what their own noise tells, where a robot differs everywhere."""
    own, usual = 0.5 * (cause.interval_90[1] - cause.interval_90[0]), usual_errors_of(study, cause)
    low, high = cause.value - np.hypot(own, usual.below), cause.value + np.hypot(own, usual.above)
    return replace(cause, interval_90=(float(low), float(high)))


def usual_errors_of(study: JointStudy, cause: Cause) -> UsualErrors:
    """What the interval of a robot's value that differs everywhere has beside its own noise."""
    return usual_errors(f"{cause.effect}.{cause.parameter}", cause.where, _standstill_rad_s(study, cause.where))


def _standstill_rad_s(study: JointStudy, where: str) -> float | None:
    """Speed within which friction near standstill falls off at a joint; None where none was found."""
    effect, _, parameter = STANDSTILL_SPEED.partition(".")
    found = (cause for a in study.fit.accepted if a.effect == effect for cause in _by_own_noise(study, a))
    return next((cause.value for cause in found if (cause.parameter, cause.where) == (parameter, where)), None)


def is_clear(study: JointStudy, cause: Cause) -> bool:
    """Whether a cause is told for itself: where a robot differs everywhere, only if its value shows that the effect is there."""
    key = f"{cause.effect}.{cause.parameter}"
    if not study.is_of_many or key not in SCALES:
        return True
    here = study.problem_start(key, index_of(study.problem.names, key, cause.where))
    is_sure = not (cause.interval_90[0] <= here <= cause.interval_90[1] or _is_at_bound(key, cause.value, here))
    return is_sure and is_telling(key, cause.where, _standstill_rad_s(study, cause.where))


def _is_at_bound(key: str, value: float, nominal: float) -> bool:
    """Whether a value ran as far as its parameter allows: then it makes up for what something else lacks."""
    return value != nominal and (value <= PARAMETERS[key].lower or value >= PARAMETERS[key].upper)


def extended_causes(study: JointStudy, causes: Sequence[Cause]) -> list[Cause]:
    """The values of the extended model where a robot differs everywhere; none where those of the causes are as good."""
    if not study.is_of_many:
        return []
    return [_likeliest(study, cause) for cause in causes]


def _likeliest(study: JointStudy, cause: Cause) -> Cause:
    key = f"{cause.effect}.{cause.parameter}"
    if key not in SCALES:
        return cause
    nominal = study.problem_start(key, index_of(study.problem.names, key, cause.where))
    return replace(cause, value=likeliest(key, cause.value, cause.interval_90, nominal))


def is_too_little(study: JointStudy, causes: Sequence[Cause]) -> bool:
    """Whether all causes of a TriFinger were fitted and are smaller than detection limits of sessions of this length.

    Of 18 such names 4 were wrong on seeds 27 and 101, of 104 larger ones 5.
    """
    if not isinstance(study.robot, KnownTriFinger) or study.is_of_many:
        return False
    seconds = sum(e.path.step_s * len(e.path.velocity) for e in study.problem.episodes)
    limits = [detection_limit(f"{cause.effect}.{cause.parameter}", seconds) for cause in causes]
    limited = {cause.effect for cause, limit in zip(causes, limits, strict=True) if limit > 0.0}
    sizes = [_deviation(study, cause) * _of_usual_factor(cause, causes) for cause in causes]
    seen = {c.effect for c, limit, size in zip(causes, limits, sizes, strict=True) if limit > 0.0 and size >= limit}
    return {cause.effect for cause in causes} <= (limited & {a.effect for a in study.fit.accepted}) - seen


def too_little_beside(study: JointStudy, causes: Sequence[Cause]) -> list[Cause]:
    """Causes that are too little beside others that are not; none where all are."""
    groups: dict[tuple[str, str], list[Cause]] = {}
    for cause in causes:
        groups.setdefault((cause.effect, cause.where), []).append(cause)
    little = [group for group in groups.values() if is_too_little(study, group)]
    return [cause for group in little for cause in group] if len(little) < len(groups) else []


def _deviation(study: JointStudy, cause: Cause) -> float:
    """From what the model had; infinite of what no fit moves."""
    key = f"{cause.effect}.{cause.parameter}"
    if key not in SCALES:
        return np.inf
    return abs(cause.value - study.problem_start(key, index_of(study.problem.names, key, cause.where)))


def _of_usual_factor(cause: Cause, causes: Sequence[Cause]) -> float:
    """What a number counts for of whose product with another it is told: limits are for the usual other one."""
    number = NUMBERS.get(f"{cause.effect}.{cause.parameter}")
    if number is None or number.product_with is None:
        return 1.0
    other, usual = number.product_with[0].partition(".")[2], PARAMETERS[number.product_with[0]].absent
    told = [c.value for c in causes if (c.effect, c.where, c.parameter) == (cause.effect, cause.where, other)]
    return told[0] / usual if told else 1.0


def may_be_absent(study: JointStudy, cause: Cause) -> bool:
    """Whether a number's interval holds what the model had; of a TriFinger healthy sessions have said that it is there."""
    key = f"{cause.effect}.{cause.parameter}"
    if isinstance(study.robot, KnownTriFinger) or key not in SCALES:
        return False
    here = study.problem_start(key, index_of(study.problem.names, key, cause.where))
    return bool(cause.interval_90[0] <= here <= cause.interval_90[1])


def _that_matter(study: JointStudy, accepted: Accepted, causes: list[Cause]) -> list[Cause]:
    """Of a cause at all joints, the joints that have it: away from nominal beyond errors, and not by a trifle."""
    if not accepted.where.startswith("all"):
        return causes
    first = accepted.terms[0].key.partition(".")[2]
    start = {name: study.problem_start(accepted.terms[0].key, j) for j, name in enumerate(study.problem.names)}
    sizes = {cause.where: abs(cause.value - start[cause.where]) for cause in causes if cause.parameter == first}
    largest = max(sizes.values(), default=0.0)
    kept = {
        cause.where
        for cause in causes
        if cause.parameter == first
        and sizes[cause.where] > 0.05 * largest
        and not cause.interval_90[0] <= start[cause.where] <= cause.interval_90[1]
    }
    return [cause for cause in causes if cause.where in kept]


def index_of(names: Sequence[str], key: str, where: str) -> int:
    """Which of a parameter's numbers a place means: a joint's, an axis', or the only one."""
    if PARAMETERS[key].scope is Scope.JOINT:
        return list(names).index(where)
    return "xyz".index(where) if where in ("x", "y", "z") else 0


def told(causes: Sequence[Cause]) -> list[str]:
    """Each effect with its places, or how many there are."""
    places: dict[str, list[str]] = {}
    for cause in causes:
        places.setdefault(cause.effect, [])
        if cause.where not in places[cause.effect]:
            places[cause.effect].append(cause.where)
    return [
        f"{effect.replace('_', ' ')} ({', '.join(where) if len(where) <= 2 else f'{len(where)} places'})"
        for effect, where in places.items()
    ]
