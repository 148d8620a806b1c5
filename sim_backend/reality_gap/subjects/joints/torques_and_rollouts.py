"""The verdict on anybody's joints: torques propose causes, rollouts decide, and sensors answer for themselves.

Equations along the motion see what a sensor does and what moves a joint a little, but they are sure of causes that do not lead
where the robot went. Simulated motions are not, but they see no sensor. So a cause of motion is named only if it rolls out.
"""

from collections.abc import Sequence
from dataclasses import replace

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.rollout_fit import is_simulated
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

_MOTION_FITS = frozenset({VerdictKind.NAMED, VerdictKind.NOTHING_WRONG})


def proposed_by(torques: Verdict, study: JointStudy) -> frozenset[tuple[str, str]]:
    """Effects at places that torques took or confused, for rollouts to try."""
    taken = {(accepted.effect, accepted.where) for accepted in study.fit.accepted}
    return frozenset(taken | {(cause.effect, cause.where) for cause in torques.causes})


def in_both(torques: Verdict, rollouts: Verdict) -> Verdict:
    """What rollouts say of the motion, with what torques say of sensors and of joints that do not move.

    Args:
        torques: verdict by equations.
        rollouts: verdict by simulated motions of the same recordings.
    """
    if torques.misreads or (torques.verdict is VerdictKind.NOT_IDENTIFIABLE and not rollouts.causes):
        return replace(torques, effects=rollouts.effects)
    seen = tuple(cause for cause in torques.causes if not _moves(cause))
    doubted = _doubted(torques, rollouts)
    kind, summary = rollouts.verdict, rollouts.summary
    if seen and kind in _MOTION_FITS:
        places = ", ".join(dict.fromkeys(f"{cause.effect.replace('_', ' ')} ({cause.where})" for cause in seen))
        beside = f"{summary} Beside it there is" if rollouts.causes else "The robot goes where the model goes; there is"
        kind, summary = VerdictKind.NAMED, f"{beside} {places}."
    cannot_tell = (*rollouts.cannot_tell, *doubted, *(said for said in torques.cannot_tell if said not in rollouts.cannot_tell))
    return replace(
        rollouts,
        verdict=kind,
        summary=summary,
        causes=(*rollouts.causes, *seen),
        follows=torques.follows if kind is VerdictKind.UNEXPLAINED else (),
        cannot_tell=tuple(dict.fromkeys(cannot_tell)),
        held_out_there=torques.held_out_there,
    )


def _moves(cause: Cause) -> bool:
    """Whether a cause is one that rollouts have."""
    key = f"{cause.effect}.{cause.parameter}"
    return is_simulated(key) or any(is_simulated(number) for number in NUMBERS if number.startswith(f"{cause.effect}."))


def _doubted(torques: Verdict, rollouts: Verdict) -> list[str]:
    """Causes of motion that torques alone would name."""
    named = {cause.effect for cause in rollouts.causes}
    unsure = sorted({cause.effect.replace("_", " ") for cause in torques.causes if _moves(cause) and cause.effect not in named})
    if torques.verdict not in (VerdictKind.NAMED, VerdictKind.CONFUSABLE) or not unsure:
        return []
    return [f"whether there is {listed(unsure)}: torques along the motion are nearer with it, simulated motions are not"]


def listed(words: Sequence[str]) -> str:
    """Words as a list in a sentence."""
    return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else "".join(words)
