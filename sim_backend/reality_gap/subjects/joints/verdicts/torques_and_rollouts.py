"""The verdict on anybody's joints: torques propose causes, rollouts decide, and sensors answer for themselves.

Equations along the motion see what a sensor does and what moves a joint a little, but they are sure of causes that do not lead
where the robot went. Simulated motions are not, but they see no sensor. So a cause of motion is named only if it rolls out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from sim_backend.reality_gap.knowledge.joint_effects import (
    COGGING_AMPLITUDE,
    COGGING_PHASE,
    FILTERED_VELOCITY,
    NUMBERS,
    OF_LATE_COLUMNS,
    SENSOR_NOISE,
    Sign,
    effect_of,
)
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import is_simulated
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Proposed
from sim_backend.reality_gap.subjects.joints.signs.cogging_cycles import seen_cogging
from sim_backend.reality_gap.verdict import Cause, Doubt, EffectJudged, Told, Verdict, VerdictKind

_MOTION_FITS = frozenset({VerdictKind.NAMED, VerdictKind.NOTHING_WRONG})
_READ_DIRECTLY = frozenset(effect_of(sign) for sign in (*SENSOR_NOISE, Sign.POSITION_STEPS))
"""Effects that readings show by themselves, whatever torques explain."""
_AS_LATE = 2.0
"""Times what a column differs by that something may be and still be the column's lateness."""
_OF_COLUMNS = frozenset({FILTERED_VELOCITY.partition(".")[0]})
"""Effects that only the columns themselves are asked for."""


def proposed_by(torques: Verdict, study: JointStudy) -> Proposed:
    """Effects at places that torques took or confused, and motors that cog, for rollouts to try; most with values."""
    state, names = study.fit.state, study.problem.names
    taken = {
        (accepted.effect, accepted.where): {
            (key, t.index): float(state.value(key)[t.index]) for t in accepted.terms for key in (t.key, *dict(t.shape))
        }
        for accepted in study.fit.accepted
    }
    lines = {
        (COGGING_AMPLITUDE.partition(".")[0], names[j]): {(COGGING_AMPLITUDE, j): amplitude_nm, (COGGING_PHASE, j): phase_rad}
        for j, (amplitude_nm, phase_rad) in seen_cogging(study.start, study.problem.episodes).items()
    }
    return {(cause.effect, cause.where): {} for cause in torques.causes} | lines | taken


def in_both(torques: Verdict, rollouts: Verdict, columns: Sequence[Cause] = (), doubts: Sequence[Doubt] = ()) -> Verdict:
    """What rollouts say of the motion, with what torques say of sensors and of joints that do not move.

    Args:
        torques: verdict by equations.
        rollouts: verdict by simulated motions of the same recordings.
        columns: what two columns of one joint say of each other: commanded and measured torque, positions and velocities.
        doubts: of causes that may be no fault.
    """
    is_right, is_off = (rollouts.verdict is kind for kind in (VerdictKind.NOTHING_WRONG, VerdictKind.UNEXPLAINED))
    too_few = torques.verdict is VerdictKind.NOT_IDENTIFIABLE and not rollouts.causes
    if (torques.misreads and not is_right) or (too_few and not is_off):
        return replace(torques, effects=_unjudged(rollouts, "it is not known what these data say"))
    if too_few:
        return _off_and_no_more(torques, rollouts)
    if rollouts.misreads:
        return replace(rollouts, cannot_tell=(*rollouts.cannot_tell, *torques.cannot_tell))
    sensed = tuple(cause for cause in torques.causes if not _moves(cause) and cause.effect not in _OF_COLUMNS)
    plain = tuple(cause for cause in sensed if torques.verdict is VerdictKind.NAMED or cause.effect in _READ_DIRECTLY)
    doubted = _doubted(torques, rollouts, [cause for cause in sensed if cause not in plain])
    seen = (*plain, *columns)
    kind, summary = rollouts.verdict, rollouts.summary
    if seen and kind in _MOTION_FITS:
        places = ", ".join(dict.fromkeys(f"{cause.effect.replace('_', ' ')} ({cause.where})" for cause in seen))
        beside = f"{summary} Beside it there is" if rollouts.causes else "The robot goes where the model goes; there is"
        kind, summary = VerdictKind.NAMED, f"{beside} {places}."
    open_ = [doubt for doubt in doubts if doubt.cause in (*rollouts.causes, *seen)]
    if open_ and kind is VerdictKind.NAMED:
        kind, summary = VerdictKind.CONFUSABLE, f"{summary} Or {open_[0].other}."
    cannot_tell = (*(f"whether {doubt.other}" for doubt in open_), *rollouts.cannot_tell, *_disagreement(torques, kind))
    cannot_tell += (*(said for said, _ in doubted), *torques.cannot_tell)
    return replace(
        rollouts,
        verdict=kind,
        summary=summary,
        causes=(*rollouts.causes, *seen),
        record_next=tuple(dict.fromkeys([*(doubt.told_by for doubt in open_), *rollouts.record_next])),
        follows=torques.follows if torques.verdict is VerdictKind.UNEXPLAINED else (),
        cannot_tell=tuple(dict.fromkeys(cannot_tell)),
        held_out_there=torques.held_out_there,
        effects=_together(rollouts, seen, {effect for _, effect in doubted}, open_),
    )


def _off_and_no_more(torques: Verdict, rollouts: Verdict) -> Verdict:
    """Of data that are too few for torques, and enough to see that the model does not go where the robot went."""
    along = f"what torques along the motion say: {torques.summary}"
    return replace(
        rollouts,
        record_next=tuple(dict.fromkeys([*torques.record_next, *rollouts.record_next])),
        cannot_tell=tuple(dict.fromkeys([along, *torques.cannot_tell, *rollouts.cannot_tell])),
        held_out_there=torques.held_out_there,
    )


def of_smoothed(
    causes: Sequence[Cause], smoothed: Mapping[str, tuple[float, float]], nominal: Callable[[Cause], float]
) -> list[Doubt]:
    """Of causes of a motion that was driven by a measured torque behind a filter: the column may be late, and no torque.

    What a late column lacks is not larger than what it differs by from the commanded one.

    Args:
        causes: of the motion.
        smoothed: joints whose measured torque follows the commanded one as through a filter, with what it is less for each rad/s
            and each rad/s^2.
        nominal: the value of a cause in the nominal model.
    """
    return [
        Doubt(
            cause,
            f"the measured torque of {cause.where} is smoothed by its sensor alone, and what acts is what was commanded",
            "the same recordings without the column of the measured torque",
        )
        for cause in causes
        if cause.effect in OF_LATE_COLUMNS
        and cause.where in smoothed
        and abs(cause.value - nominal(cause)) <= _AS_LATE * smoothed[cause.where][OF_LATE_COLUMNS.index(cause.effect)]
    ]


def with_unlike_torques(verdict: Verdict, unlike: Sequence[str]) -> Verdict:
    """A verdict beside torques that were not given as they were sent: where nothing else is wrong, that is, and has no name.

    Args:
        verdict: on the motion, which measured torques drive.
        unlike: sentences on joints whose measured torque is not what it should be.
    """
    if not unlike:
        return verdict
    if verdict.verdict is not VerdictKind.NOTHING_WRONG:
        return replace(verdict, cannot_tell=(*verdict.cannot_tell, *(f"why {said}" for said in unlike)))
    return replace(
        verdict,
        verdict=VerdictKind.UNEXPLAINED,
        summary=f"The robot goes where measured torques lead it, but {unlike[0]}.",
        follows=(*unlike[1:], *verdict.follows),
        effects=_unjudged(verdict, "what motors make of commanded torques is not explained"),
        record_next=("constant commanded torques of several sizes, for as long as the tasks take",),
    )


def _disagreement(torques: Verdict, kind: VerdictKind) -> list[str]:
    """What torques find wrong that no simulated motion shows."""
    if kind is not VerdictKind.NOTHING_WRONG:
        return []
    said = [f"whether {torques.misreads}: a smaller error speaks for it, but the model goes where the robot went"]
    law = "whether something small is wrong that moves the robot no further than a healthy one may be off: along the motion "
    of_law = [f"{law}torques say: {torques.summary}"] if torques.verdict is VerdictKind.UNEXPLAINED else []
    return said if torques.misreads else of_law


def _unjudged(rollouts: Verdict, because: str) -> tuple[EffectJudged, ...]:
    return tuple(EffectJudged(each.effect, Told.NOT_JUDGED, because=because) for each in rollouts.effects)


def _together(rollouts: Verdict, seen: Sequence[Cause], doubted: set[str], doubts: Sequence[Doubt]) -> tuple[EffectJudged, ...]:
    """What is said of each effect where sensors show some, and torques would name others; named is what the verdict names."""
    may_be = {doubt.cause.effect: f"or {doubt.other}" for doubt in doubts}
    shown, is_told = {cause.effect for cause in seen}, rollouts.verdict in _MOTION_FITS

    def told(each: EffectJudged) -> EffectJudged:
        if each.effect in may_be and is_told:
            return EffectJudged(each.effect, Told.CONFUSABLE, because=may_be[each.effect])
        if each.effect in shown and is_told:
            return EffectJudged(each.effect, Told.NAMED)
        if each.effect in shown and each.told is not Told.CONFUSABLE:
            return EffectJudged(each.effect, Told.NOT_JUDGED, because="readings show it, and where the robot went is open")
        if each.effect in doubted and each.told is not Told.NAMED:
            return EffectJudged(each.effect, Told.NOT_JUDGED, because="torques and simulated motions do not agree")
        return each

    return tuple(map(told, rollouts.effects))


def _moves(cause: Cause) -> bool:
    """Whether a cause is one that rollouts have."""
    key = f"{cause.effect}.{cause.parameter}"
    return is_simulated(key) or any(is_simulated(number) for number in NUMBERS if number.startswith(f"{cause.effect}."))


def _doubted(torques: Verdict, rollouts: Verdict, sensed: Sequence[Cause]) -> list[tuple[str, str]]:
    """Causes that torques alone would name, each as a sentence and its effect."""
    named = {cause.effect for cause in rollouts.causes}
    would = torques.causes if torques.verdict in (VerdictKind.NAMED, VerdictKind.CONFUSABLE) else ()
    moving = {cause.effect for cause in would if _moves(cause) and cause.effect not in named}
    reading = {cause.effect for cause in sensed}
    doubts = {effect: "torques along the motion are nearer with it, simulated motions are not" for effect in moving}
    doubts |= {effect: "its sensors look so, where the torques are not explained" for effect in reading}
    return [(f"whether there is {effect.replace('_', ' ')}: {why}", effect) for effect, why in sorted(doubts.items())]
