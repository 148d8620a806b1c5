"""A verdict from rollouts alone: what was taken since with it a model goes where the robot went."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.joint_effects import (
    FITTED,
    NOT_ASKED,
    POSITION_GAIN,
    SHAPES,
    Sign,
    effect_of,
)
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import FittedValue, at_usual_factor, seen_beside
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, own_share
from sim_backend.reality_gap.subjects.joints.laws.intervals import half_interval
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import TOLERATED
from sim_backend.reality_gap.subjects.joints.rollouts.explained import EXPLAINED, explained_at
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import Healthy
from sim_backend.reality_gap.subjects.joints.rollouts.limits import enough_of, is_within, of_healthy_rad
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import (
    RolloutFit,
    RolloutProblem,
)
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_questions import shown, would_move_nats
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE, Taken
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, instead, without
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import OF_NUMBER
from sim_backend.reality_gap.subjects.joints.slides import told_distance
from sim_backend.reality_gap.verdict import Cause, EffectJudged, HeldOut, Rival, Told, Verdict, VerdictKind

_SURE = 0.95
"""How sure it must be, by windows that are few, which of two models is nearer."""
CONFUSABLE_NATS, CONFUSABLE_SHARE = 5.0, 0.1
"""A rival that lies less than this behind, or than this share of what the cause gained, cannot be told apart."""
_RIVALS = 3
"""So many other effects at most are compared with a cause."""
_TRIFLE = 0.05
"""Of the largest number of a cause at all joints: a joint with less has none, unless that is more than its model may be off."""


def verdict_of_rollouts(
    study: JointStudy, selection: RolloutSelection, healthy: Healthy, with_causes: Healthy | None = None
) -> Verdict:
    """Judge what a selection came to.

    Named is what takes away at least half of a usual window's error at some joint, or three quarters where without it no joint is
    further off than healthy robots are, leaves no joint of whose error it took less further off than robots are that have nothing
    but these causes, and has settled where it fits best unless all joints are as those robots'; what few motions show is judged
    by the far windows in the same way; what does not is listed as a part of something that is not explained. Where nothing is
    named, a model is as good as right if the robot, fitted within the model's tolerances, is not further off than healthy ones
    are that were drawn within them.

    Args:
        study: of the same recordings.
        selection: causes and models.
        healthy: what usual windows of healthy robots end up off.
        with_causes: the same of robots that have the causes and are healthy else; as of healthy ones if None.
    """
    problem, names = selection.problem, study.problem.names
    causes = [cause for taken in selection.taken for cause in causes_of(study, selection.fit, taken)]
    beside = [(taken, *found) for taken in selection.taken for found in _rivals(selection, taken)]
    rivals = [rival for _, rival, _, _ in beside]
    near = [each for each in beside if _is_near(each[1], each[0]) or not _is_ahead(problem, selection.fit, each[3])]
    extended = _extended(study, selection)
    causes = [_covering(cause, extended) for cause in causes]
    before, after = selection.nominal.usual_rad, selection.fit.usual_rad
    far_before, far_after = selection.nominal.far_rad, selection.fit.far_rad
    kind, summary = VerdictKind.NAMED, f"The robot goes where a model goes that has {_listed(causes)}"
    usual_rad, far_rad = of_healthy_rad(healthy, enough_of(problem))
    left_rad, far_left_rad = of_healthy_rad(with_causes or healthy, enough_of(problem))
    is_halved, is_far_halved = after < (1.0 - EXPLAINED) * before, far_after < (1.0 - EXPLAINED) * far_before
    is_only_far = bool((after <= left_rad).all() and (far_after > far_left_rad).any())
    is_slide = study.problem.episodes[0].plant.is_slide
    said = _left(selection, names, is_slide, after, far_after if is_only_far else None)
    is_healthy = is_within(selection.nominal, (usual_rad, far_rad))
    is_gain = explained_at(selection.nominal, selection.fit, None if is_healthy else far_rad)
    is_usual = is_within(selection.fit, (left_rad, far_left_rad))
    is_little = (is_halved | (after <= left_rad)).all() and (is_far_halved | (far_after <= far_left_rad)).all()
    explains = bool(is_gain.any() and is_little)
    explains = explains and (is_usual or problem.is_near_noise(selection.fit) or would_move_nats(problem, selection.fit) < GATE)
    if is_healthy and not (causes and explains):
        worst = int(np.argmax(before / usual_rad))
        most, end = (told_distance(rad[worst], is_slide=bool(is_slide[worst])) for rad in (usual_rad, before))
        usual = f"up to {most} are usual for a robot whose model is as exact as is tolerated"
        off = f"{end} off at {names[worst]} (masses, friction and bearings fitted within their tolerances)"
        kind, causes = VerdictKind.NOTHING_WRONG, []
        summary = f"The model goes where the robot went: a window of {problem.length_s:g} s ends up {off}, and {usual}."
    elif not causes:
        kind, summary = VerdictKind.UNEXPLAINED, f"The model does not go where the robot went: {said}, and no cause explains it."
    elif not explains:
        explain = "explain" if len(selection.taken) > 1 else "explains"
        kind, summary = VerdictKind.UNEXPLAINED, f"{_listed(causes)} {explain} a part of it; then {said}."
    elif near:
        kind, summary = VerdictKind.CONFUSABLE, "Some cause explains where the robot went, but these data cannot tell which."
        causes += [cause for _, _, other, fit in near for cause in causes_of(study, fit, other)]
    else:
        usual = bool((is_halved & is_gain).any())
        summary = f"{summary}: {_with_and_without(selection, names, is_slide, is_halved if usual else is_gain, usual=usual)}."
    unknown = (
        [f"where the rest comes from: {said}"] if kind is VerdictKind.NAMED and not problem.is_near_noise(selection.fit) else []
    )
    unknown += _few_windows(selection.fit, names, is_slide, far_left_rad) if kind is VerdictKind.NAMED else []
    return Verdict(
        verdict=kind,
        summary=summary,
        causes=tuple(causes),
        extended=tuple(extended if causes else ()),
        held_out=_gained(selection),
        runner_up=min(rivals, key=lambda rival: rival.behind, default=None),
        rejected=tuple(sorted(rivals, key=lambda rival: rival.behind)),
        cannot_tell=(*unknown, *_UNSEEN),
        record_next=_next(kind, [rival for _, rival, _, _ in near]),
        effects=tuple(effects_judged(selection, kind, causes, [rival for _, rival, _, _ in near])),
    )


_OPEN = frozenset({VerdictKind.UNEXPLAINED, VerdictKind.CONFUSABLE})


def _next(kind: VerdictKind, near: Sequence[Rival]) -> tuple[str, ...]:
    """What to record where something is open."""
    if kind is VerdictKind.CONFUSABLE:
        return tuple(dict.fromkeys(rival.separated_by for rival in near))
    return ("each joint slowly and fast, unloaded and loaded",) if kind is VerdictKind.UNEXPLAINED else ()


def _left(
    selection: RolloutSelection, names: Sequence[str], is_slide: np.ndarray, usual_rad: np.ndarray, far_rad: np.ndarray | None
) -> str:
    """Where windows end up with a selection's causes: a usual one, or where those are fine one of ten."""
    problem = selection.problem
    off, which = (usual_rad, "a usual window") if far_rad is None else (far_rad, "one window of ten")
    worst = int(np.argmax(off / problem.noise_rad))
    more = "" if far_rad is None else " or more"
    end = told_distance(off[worst], is_slide=bool(is_slide[worst]))
    left = f"{which} of {problem.length_s:g} s ends up {end}{more} off at {names[worst]}"
    return f"{left}, {off[worst] / problem.noise_rad[worst]:.0f} times the noise of its encoder"


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
        elif effect in near and kind in _OPEN | _SAYS:
            rival = near[effect]
            found.append(EffectJudged(effect, Told.CONFUSABLE, because=f"at {rival.where}; what separates: {rival.separated_by}"))
        elif kind is VerdictKind.UNEXPLAINED and effect in size:
            found.append(EffectJudged(effect, Told.NOT_JUDGED, because="what is left unexplained may hide it"))
        elif np.isfinite(size.get(effect, np.inf)):
            found.append(EffectJudged(effect, Told.EXCLUDED, size[effect], units[effect]))
        else:
            found.append(EffectJudged(effect, Told.NOT_JUDGED, because=_why_not(effect, size)))
    return found


_SAYS = frozenset({VerdictKind.NAMED, VerdictKind.CONFUSABLE})


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


_OF_SENSORS = frozenset(effect_of(sign) for sign in Sign)

_UNSEEN = (
    "noise and filters of sensors, ends of joints: rollouts compare positions between them",
    "whether all torques and all masses are off by the same share: no motion shows it",
)


def _extended(study: JointStudy, selection: RolloutSelection) -> list[Cause]:
    """Numbers of the model that goes where the robot went best: the causes' own in it, and what mends the rest."""
    if not selection.mending:
        return []
    every = (*selection.taken, *selection.mending)
    return [cause for taken in every for cause in causes_of(study, selection.extended, taken)]


def _covering(cause: Cause, extended: Sequence[Cause]) -> Cause:
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
            for each in [*told, *(seen_beside(study.start, term) if term.key == taken.terms[0].key else ())]:
                of, interval = PARAMETERS[each.key], (each.value - each.error, each.value + each.error)
                found.append((term.index, Cause(taken.hypothesis.effect, of.name, where, each.value, of.unit, interval)))
            if term.key == taken.terms[0].key:
                sizes[term.index] = abs(off)
    if taken.hypothesis.where != ALL_JOINTS:
        return [cause for _, cause in found]
    least = {index: _least_of(study, taken.terms[0].key, index, max(sizes.values())) for index in sizes}
    return [cause for index, cause in found if index not in sizes or sizes[index] > least[index]]


def _least_of(study: JointStudy, key: str, index: int, largest: float) -> float:
    """What a joint must have of a cause at all joints to have it: more than a trifle of the largest, or than is tolerated."""
    robot = study.robot
    tolerated = TOLERATED * own_share(robot.tolerance, key, index, study.start) if isinstance(robot, UnknownRobot) else 0.0
    return min(_TRIFLE * largest, tolerated) if tolerated > 0.0 else _TRIFLE * largest


_Rivalling = tuple[Rival, Taken, RolloutFit]


def _rivals(selection: RolloutSelection, taken: Taken) -> list[_Rivalling]:
    """Other effects that come nearest to a cause, each with its model; the best of them at least, others if they came near.

    One that was taken later, too, stands against both: whether it would do without this one. Any other that was about as good by
    the time the cause was taken is tried once more in its place beside those that were taken later: what was best by then need
    not be.
    """
    own, later, found = taken.hypothesis, {cause.hypothesis.name for cause in selection.taken}, list[_Rivalling]()
    for gain, fit, other, terms in taken.others:
        if other.effect in {own.effect, *(each[0].effect for each in found)}:
            continue
        rival, alone = Rival(other.effect, other.where, taken.gain - gain, _separated(other.effect, own.effect)), fit
        was_near = _is_near(rival, taken)
        if found and not (was_near and len(found) < _RIVALS):
            break
        if other.name in later:
            alone = without(selection, taken)
            lost = selection.problem.gained(alone.squares, selection.fit.squares) - OF_NUMBER * len(taken.terms)
            rival = replace(rival, behind=lost)
            if not _is_near(rival, taken):
                continue
        elif len(selection.taken) > 1 and (was_near or len(selection.problem.windows) < LEAST_WINDOWS):
            alone = instead(selection, taken, fit, terms)
            lost = selection.problem.gained(alone.squares, selection.fit.squares)
            rival = replace(rival, behind=lost - OF_NUMBER * (len(taken.terms) - len(terms)))
        found.append((rival, Taken(other, terms, gain, ()), alone))
    return found


def _separated(other: str, own: str) -> str:
    return separated_by(other, own, "slow and fast motion, little and much load")


def _is_near(rival: Rival, taken: Taken) -> bool:
    """Whether two causes explain the same: one that follows so closely may only have been fitted a little worse."""
    return rival.behind < max(CONFUSABLE_NATS, CONFUSABLE_SHARE * taken.gain)


def _is_ahead(problem: RolloutProblem, fit: RolloutFit, other: RolloutFit) -> bool:
    """Whether a model is surely nearer than another, by what their windows say of that where these are few.

    Nats are of errors that are noise. Real robots leave more than that, and a few windows may prefer one of two wrong laws by
    chance. Source: Q. H. Vuong, Econometrica 57 (1989) 307, with Student's law.
    """
    windows = len(problem.windows)
    if windows >= LEAST_WINDOWS:
        return True
    ahead = problem.gained_by_window(other.squares, fit.squares)
    error = float(ahead.std(ddof=1)) / np.sqrt(windows) if windows > 1 else np.inf
    return bool(ahead.mean() > special.stdtrit(windows - 1, _SURE) * error)


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


def _listed(causes: Sequence[Cause]) -> str:
    """Each effect with its places."""
    places: dict[str, list[str]] = {}
    for cause in causes:
        if cause.where not in places.setdefault(cause.effect, []):
            places[cause.effect].append(cause.where)
    return ", ".join(f"{effect.replace('_', ' ')} ({', '.join(where)})" for effect, where in places.items())
