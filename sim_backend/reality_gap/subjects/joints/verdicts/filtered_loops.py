"""What a late velocity does in a loop whose torques nobody recorded: it looks like a lighter rotor, and is none."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import ARMATURE, FILTERED_VELOCITY
from sim_backend.reality_gap.verdict import Cause, EffectJudged, Told, Verdict, VerdictKind

_SHARE = 0.25
"""Of what a filter does to a loop by the first order of its time constant: what higher orders may add."""


def without_loops_of_filters(
    rollouts: Verdict, filters: Sequence[Cause], names: Sequence[str], inertia_kg_m2: np.ndarray, damping_nm_s_rad: np.ndarray
) -> Verdict:
    """A verdict of rollouts without the inertias that a filter in a simulated loop has instead, or another way of being late.

    The damping of a controller acts on the velocity that it is given. A filter of ``T`` seconds makes that late, which is to
    first order the torque ``damping T`` for each rad/s^2: the loop of a rotor that has so much less inertia.

    Args:
        rollouts: what simulated motions came to, with controllers that are given what joints really do.
        filters: what velocities say of their sensors, with those that may be late without a filter.
        names: of the joints, k.
        inertia_kg_m2: of their nominal rotors, shape (k,).
        damping_nm_s_rad: of controllers whose torques were not recorded, shape (k,); NaN at all other joints.
    """
    inertia, by_filter = ARMATURE.split("."), {each.where: each for each in filters if _is_filter(each)}

    def is_the_filter_s(cause: Cause) -> bool:
        if [cause.effect, cause.parameter] != inertia or cause.where not in by_filter:
            return False
        j, found = names.index(cause.where), by_filter[cause.where]
        less = damping_nm_s_rad[j] * found.value
        half = 0.5 * (cause.interval_90[1] - cause.interval_90[0]) + _SHARE * less
        return bool(np.isfinite(less) and abs(cause.value - (inertia_kg_m2[j] - less)) <= half)

    gone = [cause.where for cause in rollouts.causes if is_the_filter_s(cause)]
    if not gone:
        return rollouts
    kept = tuple(cause for cause in rollouts.causes if not is_the_filter_s(cause))
    where, effect = ", ".join(gone), inertia[0]
    name = effect.replace("_", " ")
    said = f"whether there is {name} ({where}): its controller is given a late velocity, which looks like it"
    judged = tuple(
        EffectJudged(effect, Told.NOT_JUDGED, because="a late velocity does the same in the controller's loop")
        if each.effect == effect and not any(cause.effect == effect for cause in kept)
        else each
        for each in rollouts.effects
    )
    found = replace(rollouts, causes=kept, cannot_tell=(said, *rollouts.cannot_tell), effects=judged)
    if kept or rollouts.verdict not in (VerdictKind.NAMED, VerdictKind.CONFUSABLE):
        summary = f"{rollouts.summary} What looks like {name} at {where} is the late velocity in its controller's loop."
        return replace(found, summary=summary)
    summary = f"The robot goes where the model goes once the velocity is as late in its controller's loop ({where})."
    return replace(found, verdict=VerdictKind.NOTHING_WRONG, summary=summary)


def _is_filter(cause: Cause) -> bool:
    """Whether a cause is the time constant of a velocity's filter."""
    return f"{cause.effect}.{cause.parameter}" == FILTERED_VELOCITY
