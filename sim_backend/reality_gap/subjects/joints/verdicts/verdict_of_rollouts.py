"""A verdict from rollouts alone: what was taken since with it a model goes where the robot went."""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.rollouts.explained import explained_beside, is_halved
from sim_backend.reality_gap.subjects.joints.rollouts.limits import HealthyLimits
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import would_move_nats
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.slides import told_distance
from sim_backend.reality_gap.subjects.joints.verdicts.causes import index_of
from sim_backend.reality_gap.subjects.joints.verdicts.recordings import Recordings
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_causes import causes_of, covering, extended_causes, products_of
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_effects import effects_judged
from sim_backend.reality_gap.subjects.joints.verdicts.rollout_rivals import is_ahead, is_near, rivals_of
from sim_backend.reality_gap.verdict import Cause, HeldOut, Rival, Verdict, VerdictKind

_MOST_TOLD = 5
"""Windows of which it is told when they begin."""
_UNSEEN = (
    "noise and filters of sensors, ends of joints: rollouts compare positions between them",
    "whether all torques and all masses are off by the same share: no motion shows it",
)


def verdict_of_rollouts(
    study: JointStudy, selection: RolloutSelection, healthy: HealthyLimits, with_causes: HealthyLimits
) -> Verdict:
    """Judge what a selection came to.

    Named is what takes away at least half of a usual window's error at some joint, or three fifths where without it no joint is
    further off than healthy robots are, leaves no joint of whose error it took less further off than robots are that have nothing
    but these causes, and has settled where it fits best unless all joints are as those robots'; what few motions show is judged
    by the far windows in the same way, and where nothing but few windows are off only if with the causes no joint is further off
    than those robots are. In no recording may the model without causes go where the robot went, and with them not. What does not
    do all this is listed as a part of something that is not explained. Where nothing is
    named, a model is as good as right if the robot, fitted within the model's tolerances, is not further off than healthy ones
    are that were drawn within them.

    Args:
        study: of the same recordings.
        selection: causes and models.
        healthy: of robots that nothing is wrong with, for the model without causes.
        with_causes: of robots that have the causes and are healthy else, or healthy ones where next to nothing is left, for the
            model with them.
    """
    problem, names = selection.problem, study.problem.names
    causes = [cause for taken in selection.taken for cause in causes_of(study, selection.fit, taken)]
    beside = [(taken, *found) for taken in selection.taken for found in rivals_of(selection, taken)]
    rivals = [rival for _, rival, _, _ in beside]
    near = [each for each in beside if is_near(each[1], each[0]) or not is_ahead(problem, selection.fit, each[3])]
    extended = extended_causes(study, selection)
    causes = [covering(cause, extended) for cause in causes]
    before, after = selection.nominal.usual_rad, selection.fit.usual_rad
    far_before, far_after = selection.nominal.far_rad, selection.fit.far_rad
    kind, summary = VerdictKind.NAMED, f"The robot goes where a model goes that has {_listed(causes, _in_model(study))}"
    halved, far_halved = is_halved(before, after), is_halved(far_before, far_after)
    far_rad = with_causes.far_for(selection.fit)
    is_slide = study.problem.episodes[0].plant.is_slide
    said = _left(selection, names, is_slide, with_causes)
    is_healthy, is_healthy_but_for_few = healthy.hold(selection.nominal), healthy.hold_but_for_few(selection.nominal)
    is_gain = explained_beside(selection.nominal, selection.fit, healthy, with_causes)
    is_little = (halved | (after <= with_causes.usual_rad)) & (far_halved | (far_after <= far_rad))
    explains = bool(is_gain.any() and is_little.all()) and _has_settled(problem, selection.fit, with_causes)
    recordings = Recordings(study, selection, healthy.usual_rad)
    explains = explains and not recordings.contradict(with_causes.usual_rad)
    if is_healthy and not (causes and explains):
        worst = int(np.argmax(before / healthy.usual_rad))
        most, end = (told_distance(rad[worst], is_slide=bool(is_slide[worst])) for rad in (healthy.usual_rad, before))
        usual = f"up to {most} are usual for a robot whose model is as exact as is tolerated"
        off = f"{end} off at {names[worst]} (masses, friction and bearings fitted within their tolerances)"
        kind, causes = VerdictKind.NOTHING_WRONG, []
        summary = f"The model goes where the robot went: a window of {problem.length_s:g} s ends up {off}, and {usual}."
    elif not causes:
        kind, summary = VerdictKind.UNEXPLAINED, f"The model does not go where the robot went: {said}, and no cause explains it."
    elif not explains:
        explain = "explain" if len(selection.taken) > 1 else "explains"
        kind, summary = VerdictKind.UNEXPLAINED, f"{_listed(causes, _in_model(study))} {explain} a part of it; then {said}."
    elif near:
        kind, summary = VerdictKind.CONFUSABLE, "Some cause explains where the robot went, but these data cannot tell which."
        causes += [cause for _, _, other, fit in near for cause in causes_of(study, fit, other)]
    else:
        usual = bool((halved & is_gain).any())
        summary = f"{summary}: {_with_and_without(selection, names, is_slide, halved if usual else is_gain, usual=usual)}."
    unknown = (
        [f"where the rest comes from: {said}"] if kind is VerdictKind.NAMED and not problem.is_near_noise(selection.fit) else []
    )
    unknown += recordings.apart() if kind is VerdictKind.UNEXPLAINED else []
    is_right, right_rad = kind is VerdictKind.NOTHING_WRONG, healthy.far_for(selection.nominal)
    fit, limit_rad = (selection.nominal, right_rad) if is_right else (selection.fit, far_rad)
    few = _few_windows(fit, names, is_slide, limit_rad) if is_right or kind is VerdictKind.NAMED else []
    is_few = (is_right and few) or (kind is VerdictKind.UNEXPLAINED and is_healthy_but_for_few)
    look = _where_few(study, selection, right_rad) if is_few else ()
    return Verdict(
        verdict=kind,
        summary=summary,
        causes=tuple(causes),
        extended=tuple(extended if causes else ()),
        held_out=_gained(selection),
        runner_up=min(rivals, key=lambda rival: rival.behind, default=None),
        rejected=tuple(sorted(rivals, key=lambda rival: rival.behind)),
        cannot_tell=(*unknown, *few, *products_of(study, causes), *_UNSEEN),
        record_next=look or _next(kind, [rival for _, rival, _, _ in near]),
        effects=tuple(effects_judged(selection, kind, causes, [rival for _, rival, _, _ in near])),
    )


def _next(kind: VerdictKind, near: Sequence[Rival]) -> tuple[str, ...]:
    """What to record where something is open."""
    if kind is VerdictKind.CONFUSABLE:
        return tuple(dict.fromkeys(rival.separated_by for rival in near))
    return ("each joint slowly and fast, unloaded and loaded",) if kind is VerdictKind.UNEXPLAINED else ()


def _has_settled(problem: RolloutProblem, fit: RolloutFit, limits: HealthyLimits) -> bool:
    """Whether all joints are as those of robots that have these causes, or a model fits best where it is."""
    return limits.hold(fit) or problem.is_near_noise(fit) or would_move_nats(problem, fit) < GATE


def _where_few(study: JointStudy, selection: RolloutSelection, limit_rad: np.ndarray) -> tuple[str, ...]:
    """When the windows begin, of the joint that is furthest beyond its limit, that are off where most are not.

    That joint is the one whose far windows are; where no far window is, the one whose furthest is.
    """
    problem, fit = selection.problem, selection.nominal
    off_rad = fit.far_rad if (fit.far_rad > limit_rad).any() else np.sqrt(fit.squares.max(axis=0))
    worst, past = int(np.argmax(off_rad / limit_rad)), problem.windows.past
    if past is None:
        return ()
    rows = np.flatnonzero(np.sqrt(fit.squares[:, worst]) > limit_rad[worst])[:_MOST_TOLD]
    recordings = [episode.path.recording.name for episode in study.problem.episodes]
    begins = [f"{recordings[past.owner[row]]} from {past.first[row] * past.step_s[past.owner[row]]:.3g} s on" for row in rows]
    return (f"look at what happened at {study.problem.names[worst]} in {', '.join(begins)}, or record again without it",)


def _left(selection: RolloutSelection, names: Sequence[str], is_slide: np.ndarray, limits: HealthyLimits) -> str:
    """Where usual windows end up with a selection's causes, or one of ten, at the joint that is furthest beyond its limit."""
    problem, fit = selection.problem, selection.fit
    is_only_far = bool((fit.usual_rad <= limits.usual_rad).all() and (fit.far_rad > limits.far_for(fit)).any())
    off, limit, which, more = fit.usual_rad, limits.usual_rad, "a usual window", ""
    if is_only_far:
        off, limit, which, more = fit.far_rad, limits.far_for(fit), "one window of ten", " or more"
    worst = int(np.argmax(off / limit))
    end, most = (told_distance(rad[worst], is_slide=bool(is_slide[worst])) for rad in (off, limit))
    left = f"{which} of {problem.length_s:g} s ends up {end}{more} off at {names[worst]}"
    return f"{left}, {off[worst] / problem.noise_rad[worst]:.0f} times the noise of its encoder (up to {most} is usual)"


def _with_and_without(
    selection: RolloutSelection, names: Sequence[str], is_slide: np.ndarray, shows: np.ndarray, *, usual: bool
) -> str:
    """Where windows end up with a selection's causes and without, usual ones or one of ten, at the joint that shows it best."""
    nominal, fit = selection.nominal, selection.fit
    before, after = (nominal.usual_rad, fit.usual_rad) if usual else (nominal.far_rad, fit.far_rad)
    best = int(np.argmax(np.where(shows, (before - after) / selection.problem.noise_rad, -np.inf)))
    with_it, without_it = (told_distance(rad[best], is_slide=bool(is_slide[best])) for rad in (after, before))
    which, more = ("a usual window", "") if usual else ("one window of ten", " or more")
    return f"{which} of {selection.problem.length_s:g} s ends up {with_it}{more} off at {names[best]}, {without_it} without that"


def _few_windows(fit: RolloutFit, names: Sequence[str], is_slide: np.ndarray, limit_rad: np.ndarray) -> list[str]:
    """Of joints of which nine windows of ten are near enough: the others that are not, if the whole error is theirs."""
    found, off_rad = [], np.sqrt(fit.squares)
    for j in map(int, np.flatnonzero((fit.far_rad <= limit_rad) & (np.sqrt(fit.squares.mean(axis=0)) > limit_rad))):
        few, worst = int((off_rad[:, j] > limit_rad[j]).sum()), float(off_rad[:, j].max())
        end = f"as far as {told_distance(worst, is_slide=bool(is_slide[j]))} off" if np.isfinite(worst) else "nowhere"
        found.append(f"what happened in {few} of {len(off_rad)} windows: they end up {end} at {names[j]}")
    return found


def _gained(selection: RolloutSelection) -> HeldOut:
    """Errors of the windows without and with the causes; both fitted to the same windows."""
    problem = selection.problem
    before, after = (float(np.sqrt(fit.squares.mean())) for fit in (selection.nominal, selection.fit))
    ratios = np.sqrt(selection.fit.squares.sum(axis=1) / np.maximum(selection.nominal.squares.sum(axis=1), 1e-30))
    low, high = (float(1.0 - edge) for edge in np.quantile(ratios, [0.975, 0.025]))
    return HeldOut(
        metric=f"how far windows of {problem.length_s:g} s end up from where the robot was (root mean square over all joints)",
        unit="rad",
        before=before,
        after=after,
        noise_floor=float(np.sqrt((problem.noise_rad**2).mean())),
        reduction=1.0 - after / max(before, 1e-30),
        reduction_interval_95=(low, high),
        samples=int(problem.windows.position_rad.size),
        is_unseen=False,
    )


def _in_model(study: JointStudy) -> Callable[[Cause], float]:
    """How much the nominal model has of a cause whose number is an amount, such as friction; 0 of all others."""

    def amount(cause: Cause) -> float:
        key = f"{cause.effect}.{cause.parameter}"
        is_amount = key in PARAMETERS and PARAMETERS[key].absent == 0.0 and PARAMETERS[key].lower >= 0.0
        return study.problem_start(key, index_of(study.problem.names, key, cause.where)) if is_amount else 0.0

    return amount


def _listed(causes: Sequence[Cause], in_model: Callable[[Cause], float]) -> str:
    """Each effect with its places; of what the model has some of, whether there is less of it or more."""
    places, seen = dict[str, list[str]](), set[tuple[str, str]]()
    for cause in causes:
        if (cause.effect, cause.where) not in seen:
            seen.add((cause.effect, cause.where))
            effect, had = cause.effect.replace("_", " "), in_model(cause)
            effect = f"{'less' if cause.value < had else 'more'} {effect}" if had > 0.0 else effect
            places.setdefault(effect, []).append(cause.where)
    return ", ".join(f"{effect} ({', '.join(where)})" for effect, where in places.items())
