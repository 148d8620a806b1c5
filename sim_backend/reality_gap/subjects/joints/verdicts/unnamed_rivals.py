"""Laws that the catalogue lacks and that a cause may stand for: real measurements have them, and a cause must be better.

A torque that is always there (the zero of a sensor, a cable) looks like gravity, a spring or a direction of friction; drag that
grows with the square of speed looks like any friction.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.unnamed_laws import BRAKING, DRAG, LAWS, UnnamedLaw
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import apart
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE, Taken
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import OF_NUMBER, as_nominal
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_effects import effects_judged
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_rivals import CONFUSABLE_NATS, CONFUSABLE_SHARE
from sim_backend.reality_gap.verdict import Verdict, VerdictKind

_HALVED = 0.5
_PROBE_SHARE = 0.01
"""Of what a number of the same unit may be."""


def against_unnamed(verdict: Verdict, selection: RolloutSelection, usual_rad: np.ndarray) -> Verdict:
    """A verdict of rollouts as it stands beside laws without a name.

    What a law explains clearly better than a cause, or with which half of what is left goes that healthy robots do not leave, is
    not explained by the causes; what a law explains as well cannot be told apart from it. Of what is unexplained anyhow it is
    told with which law half of it goes.

    Args:
        verdict: what rollouts came to.
        selection: that it was drawn from.
        usual_rad: what usual windows of healthy robots that have the causes may be off, shape (k,).
    """
    if verdict.verdict is VerdictKind.UNEXPLAINED and (law := _beside(selection, usual_rad)) is not None:
        summary = f"{verdict.summary} With {law.said} half of what is left goes, and no effect of the catalogue is that."
        return replace(verdict, summary=summary, record_next=tuple(dict.fromkeys([law.separated_by, *verdict.record_next])))
    if verdict.verdict not in (VerdictKind.NAMED, VerdictKind.CONFUSABLE) or not selection.taken:
        return verdict
    rivals = [(cause, law, _behind(selection, cause, law)) for cause in selection.taken for law in LAWS]
    better = [
        f"{law.said} explains more than {_named(cause)}"
        for cause, law, behind in rivals
        if behind < -GATE and cause.hypothesis.effect not in law.alike
    ]
    if not better and (law := _beside(selection, usual_rad)) is not None:
        better = [f"with {law.said} half of what they leave goes"]
    if better:
        effects = effects_judged(selection, VerdictKind.UNEXPLAINED, verdict.causes, ())
        summary = f"What is found explains a part of it: {better[0]}, and no effect of the catalogue is that."
        return replace(verdict, verdict=VerdictKind.UNEXPLAINED, summary=summary, effects=tuple(effects))
    near = [(cause, law) for cause, law, behind in rivals if behind < max(CONFUSABLE_NATS, CONFUSABLE_SHARE * cause.gain)]
    if not near:
        return verdict
    said = [f"whether it is {_named(cause)} or {law.said}: both explain it" for cause, law in near]
    return replace(
        verdict,
        verdict=VerdictKind.CONFUSABLE,
        summary=f"{verdict.summary} {near[0][1].said.capitalize()} explains it as well.",
        cannot_tell=(*said, *verdict.cannot_tell),
        record_next=tuple(dict.fromkeys([*verdict.record_next, *(law.separated_by for _, law in near)])),
    )


def _named(cause: Taken) -> str:
    return f"{cause.hypothesis.effect.replace('_', ' ')} ({cause.hypothesis.where})"


def _terms(selection: RolloutSelection, law: UnnamedLaw, joints: Sequence[int]) -> list[Term]:
    scales = selection.problem.catalogue.scales
    taken = {(term.key, term.index) for cause in selection.taken for term in cause.terms}
    if law.of_voltage:
        by_voltage = _by_voltage(selection)
        joints = [j for j in joints if by_voltage[j]]
    every = [
        Term(key, j, _PROBE_SHARE * scales[like] if isinstance(like, str) else like) for j in joints for key, like in law.probes
    ]
    return [term for term in every if (term.key, term.index) not in taken]


def _by_voltage(selection: RolloutSelection) -> np.ndarray:
    """Joints whose motors are driven by voltage, so that their own takes torque, shape (k,)."""
    law = selection.problem.windows.feedback
    if law is None:
        return np.zeros(selection.fit.state.joints, bool)
    return np.asarray((np.nan_to_num(law.back_emf_nm_s_rad) > 0.0).any(axis=(0, 1)))


def _is_possible(fit: RolloutFit) -> bool:
    """Neither drag nor a motor's own voltage drives anything."""
    return bool((fit.state.value(DRAG) >= 0.0).all() and (fit.state.value(BRAKING) >= -1.0).all())


def _behind(selection: RolloutSelection, cause: Taken, law: UnnamedLaw) -> float:
    """Nats by which a law lies behind the cause that it takes the place of; infinite where it may not."""
    if cause.hypothesis.effect not in law.mistaken:
        return np.inf
    problem, fit = selection.problem, selection.fit
    every = range(fit.state.joints)
    own = sorted({t.index for t in cause.terms if PARAMETERS[t.key].scope is Scope.JOINT})
    terms = _terms(selection, law, own or every)
    if not terms:
        return np.inf
    kept = [term for other in selection.taken if other is not cause for term in other.terms]
    without = as_nominal(problem, fit.state, cause.terms)
    found = [problem.fitted(without, [*kept, *terms], fit.begin)]
    if (values := _as_lossy(selection, cause, terms)) is not None:
        found.append(problem.fitted(without.with_values(values), [*kept, *terms]))
    behind = [problem.gained(each.squares, fit.squares) for each in found if _is_possible(each)]
    return min(behind, default=np.inf) + OF_NUMBER * (len(terms) - len(cause.terms))


def _as_lossy(selection: RolloutSelection, cause: Taken, terms: Sequence[Term]) -> dict[tuple[str, int], float] | None:
    """Drag that takes as much energy as a cause's viscous friction: from no drag a fit may not find there; None of all else."""
    (like,) = (dict(law.probes)[DRAG] for law in LAWS if DRAG in dict(law.probes))
    if {term.key for term in terms} != {DRAG} or {term.key for term in cause.terms} != {like}:
        return None
    problem, speed = selection.problem, np.abs(selection.problem.windows.begin_rad_s)
    share = (speed**2).mean(axis=0) / np.maximum((speed**3).mean(axis=0), 1e-12)
    off = apart(selection.fit.state, problem.start, cause.terms)
    return {(DRAG, t.index): max(0.0, float(by * share[t.index])) for t, by in zip(cause.terms, off, strict=True)}


def _beside(selection: RolloutSelection, usual_rad: np.ndarray) -> UnnamedLaw | None:
    """A law of motion with which windows of some joint end up half as far off as with the causes; None if that is usual already.

    Not one of masses, which has so many numbers that it mends others' laws.
    """
    problem, fit = selection.problem, selection.fit
    is_left = fit.usual_rad > usual_rad
    if problem.is_near_noise(fit) or not is_left.any():
        return None
    own = [term for cause in selection.taken for term in cause.terms]
    for law in (law for law in LAWS if len(law.probes) == 1):
        if not (terms := _terms(selection, law, range(fit.state.joints))):
            continue
        found = problem.fitted(fit.state, [*own, *terms], fit.begin)
        gain = problem.gained(fit.squares, found.squares) - OF_NUMBER * len(terms)
        if gain > GATE and _is_possible(found) and bool((is_left & (found.by_joint_rad < _HALVED * fit.by_joint_rad)).any()):
            return law
    return None
