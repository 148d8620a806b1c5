"""Motors that are all weak at once: a wrong constant makes masses, rotors and frictions too small, and a supply may be weak."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import MOTOR_LOSS, SCALES, TORQUE_CONSTANT
from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import OF_NUMBER
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_rivals import CONFUSABLE_NATS, CONFUSABLE_SHARE
from sim_backend.reality_gap.verdict import Cause, Doubt, Told, Verdict, VerdictKind


def against_weak_motors(verdict: Verdict, study: JointStudy, selection: RolloutSelection, is_driven: Sequence[bool]) -> Verdict:
    """A verdict with more causes than there are motors, as it stands beside the constants of all motors.

    The search takes one cause after the other, and none of the constants explains much while the others are as they were.

    Args:
        verdict: what rollouts came to.
        study: of the same recordings.
        selection: that it was drawn from.
        is_driven: joints that a torque drives, shape (k,).
    """
    problem, fit, key = selection.problem, selection.fit, TORQUE_CONSTANT
    own = [term for taken in selection.taken for term in taken.terms]
    motors = [Term(key, int(j), 0.01 * SCALES[key]) for j in np.flatnonzero(is_driven)]
    if verdict.verdict is not VerdictKind.NAMED or len(own) <= len(motors) or any(term.key == key for term in own):
        return verdict
    found = problem.fitted(problem.start, motors)
    behind = problem.gained(found.squares, fit.squares) + OF_NUMBER * (len(motors) - len(own))
    whole = problem.gained(selection.nominal.squares, fit.squares)
    if behind >= max(CONFUSABLE_NATS, CONFUSABLE_SHARE * whole):
        return verdict
    said = f"The constants of all motors ({len(motors)}) explain as much as all of these ({len(own)})."
    blamed = {cause.effect for cause in verdict.causes}
    separates = tuple(separated_by(key.partition(".")[0], effect, "a known weight on each joint") for effect in sorted(blamed))
    return replace(
        verdict,
        verdict=VerdictKind.CONFUSABLE,
        summary=f"{verdict.summary} {said}",
        causes=(*_constants(study, found), *verdict.causes),
        extended=(),
        record_next=tuple(dict.fromkeys((*separates[:1], *verdict.record_next))),
        effects=tuple(
            replace(each, told=Told.CONFUSABLE, because=said, above=None)
            if each.effect in {*blamed, key.partition(".")[0]}
            else each
            for each in verdict.effects
        ),
    )


def _constants(study: JointStudy, fit: RolloutFit) -> list[Cause]:
    """Of all motors, with their intervals."""
    parameter, found = PARAMETERS[TORQUE_CONSTANT], []
    for term, error in zip(fit.terms, fit.errors, strict=True):
        if term.key == TORQUE_CONSTANT:
            value = float(fit.state.value(term.key)[term.index])
            half = half_interval(term.key, value, study.problem_start(term.key, term.index), float(error))
            where = study.problem.names[term.index]
            found.append(Cause(term.effect, parameter.name, where, value, parameter.unit, (value - half, value + half)))
    return found


def perhaps_a_weak_supply(study: JointStudy, causes: Sequence[Cause], is_driven: Sequence[bool]) -> list[Doubt]:
    """Of all motors that get weaker with heat which nobody measured: that what supplies them does.

    Args:
        study: of the recordings.
        causes: of the motion.
        is_driven: joints that a torque drives, shape (k,).
    """
    warm = [cause for cause in causes if f"{cause.effect}.{cause.parameter}" == MOTOR_LOSS]
    driven = {name for name, drives in zip(study.problem.names, is_driven, strict=True) if drives}
    is_measured = any(episode.path.joints.temperature_rise_k is not None for episode in study.problem.episodes)
    if is_measured or {cause.where for cause in warm} != driven:
        return []
    other = "what supplies all motors gets weaker while they move"
    return [Doubt(cause, other, "the voltage of the supply, or the temperatures of the motors") for cause in warm]
