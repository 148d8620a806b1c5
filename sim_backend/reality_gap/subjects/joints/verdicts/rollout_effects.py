"""What a verdict from rollouts says of every effect of the catalogue."""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import FITTED, NOT_ASKED, POSITION_GAIN, Sign, effect_of
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import shown
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.verdict import Cause, EffectJudged, Rival, Told, VerdictKind

_SAYS = frozenset({VerdictKind.NAMED, VerdictKind.CONFUSABLE})
_OF_SENSORS = frozenset(effect_of(sign) for sign in Sign)


def effects_judged(
    selection: RolloutSelection, kind: VerdictKind, causes: Sequence[Cause], rivals: Sequence[Rival]
) -> list[EffectJudged]:
    """What is said of every effect of the catalogue: none is passed over in silence; ``rivals`` cannot be told apart."""
    named = {cause.effect for cause in causes} if kind in _SAYS else set[str]()
    near = {rival.effect: rival for rival in rivals}
    size: dict[str, float] = {}
    units: dict[str, str] = {}
    for each in shown(selection.problem, selection.fit, selection.problem.catalogue.hypotheses, GATE):
        effect = each.hypothesis.effect
        if each.hypothesis.where != ALL_JOINTS:
            size[effect] = max(size.get(effect, 0.0), each.size)
            units[effect] = PARAMETERS[selection.problem.catalogue.terms[each.hypothesis.terms[0]].key].unit
    found = []
    for effect in CATALOGUE:
        if effect in named:
            found.append(EffectJudged(effect, Told(kind.value)))
        elif effect in near and kind in _SAYS | {VerdictKind.UNEXPLAINED}:
            rival = near[effect]
            found.append(EffectJudged(effect, Told.CONFUSABLE, because=f"at {rival.where}; what separates: {rival.separated_by}"))
        elif kind is VerdictKind.UNEXPLAINED and effect in size:
            found.append(EffectJudged(effect, Told.NOT_JUDGED, because="what is left unexplained may hide it"))
        elif np.isfinite(size.get(effect, np.inf)):
            found.append(EffectJudged(effect, Told.EXCLUDED, size[effect], units[effect]))
        else:
            found.append(EffectJudged(effect, Told.NOT_JUDGED, because=_why_not(effect, size)))
    return found


def _why_not(effect: str, asked: Mapping[str, float]) -> str:
    """Why an effect is not judged."""
    if effect in asked:
        return "at some joint these motions do not show it"
    if effect in NOT_ASKED:
        return NOT_ASKED[effect]
    if effect == POSITION_GAIN.partition(".")[0]:
        return "it shows where a controller is known whose torques were not recorded: recorded ones have it already"
    if effect in FITTED:
        return (
            "only a robot can have it whose driver is known"
            if FITTED[effect].of_the_driver
            else "simulated motions do not show it"
        )
    if effect in _OF_SENSORS:
        return "said beside the verdict where sensors show it"
    return "it is no effect of joints"
