"""From a fit of joints to a verdict: named, confusable, unexplained or nothing wrong."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import (
    ENDS,
    FELT,
    FITTED,
    SENSOR_NOISE,
    Channel,
    Sign,
    effect_of,
    scales_everything,
)
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.quantiles import Z_90
from sim_backend.reality_gap.subjects.joints.gain import errors_of, held_out_errors
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.fitted_values import fitted_values
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.laws.moves import moved
from sim_backend.reality_gap.subjects.joints.signs.checks import Finding, place
from sim_backend.reality_gap.subjects.joints.torques.look import BENT_TIE, Accepted, Candidate, Look
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import WHOLE_EPISODES
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import Pattern, lasting, patterns
from sim_backend.reality_gap.subjects.joints.verdicts.causes import (
    causes_of,
    extended_causes,
    is_clear,
    is_too_little,
    may_be_absent,
    place_of,
    told,
    too_little_beside,
)
from sim_backend.reality_gap.subjects.joints.verdicts.untold import perhaps_absent, too_little, untold
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_unknown_robot import ALMOST, reconsidered
from sim_backend.reality_gap.verdict import Cause, Rival, Verdict, VerdictKind

CONFUSABLE_NATS = 5.0
"""A rival that lies less than this behind cannot be told apart: odds of 150."""
PATTERN_NATS = 25.0
"""A pattern in what is left that gains less is what healthy sessions have, too."""
_VELOCITY_FACTOR = 8.0
"""Reported velocities follow the motion a little by themselves: both are smoothed, but not by the same board."""
_LEFT_BY_PLAY = 1.2
"""Nats of each row of the mechanics: play in gears left 1.6 to 2.1 in eight robots, other causes at most 0.9, noise 0.3."""
_SHAPE = 3.0
"""Times what the causes gained, that a pattern at a joint whose error is almost gone gains at most as the shape of their laws."""
_TRADED_SCALE, _TRADED = 0.2, 2
"""So many torques or masses that seem off by more than this take the place of something else."""


@dataclass(frozen=True)
class JointVerdict:
    """A verdict and what it was drawn from."""

    verdict: Verdict
    patterns: tuple[Pattern, ...]


def judge(study: JointStudy) -> JointVerdict:
    """Judge a study of joints (held-out errors are added by ``gain``)."""
    fit, names = study.fit, study.problem.names
    fitted = [cause for a in fit.accepted for cause in causes_of(study, a)]
    causes = [cause for cause in fitted if not may_be_absent(study, cause)]
    acting = {f.joint for f in study.findings if f.sign in FELT}
    findings = [f for f in study.findings if not (f.sign in SENSOR_NOISE and f.joint in acting)]  # the joint shakes
    noise = _filtered_noise(causes, study)
    fitted, causes = [cause for cause in fitted if cause not in noise], [cause for cause in causes if cause not in noise]
    causes += [_found(f, names) for f in findings if _is_shown(f, study)]
    little = too_little_beside(study, causes)
    causes = [cause for cause in causes if cause not in little]
    left = patterns(study.problem.episodes, fit.last, study.start.size)
    dropped = {cause.effect for cause in (*little, *noise)} - {cause.effect for cause in causes}
    found = {a: rival for a in fit.accepted if a.effect not in dropped and (rival := _rival(study, a)) is not None}
    rivals, close = list(found.values()), [rival for a, rival in found.items() if rival[0].behind < _tie_nats(a, study.robot)]
    kind, summary = _kind(study, causes, left, is_tie=bool(close))
    closest = min(rivals, key=lambda r: r[0].behind)[0] if rivals else None
    confusable = kind is VerdictKind.CONFUSABLE
    if confusable:
        causes += [cause for _, members in close for cause in members]
    gains = [a.gain for a in fit.accepted] or ([fit.first.best.gain] if fit.first.best is not None and not causes else [])
    null_p = study.robot.healthy.null_p(max(gains)) if isinstance(study.robot, KnownTriFinger) and gains else None
    verdict = Verdict(
        verdict=kind,
        summary=summary,
        causes=tuple(causes),
        extended=tuple(extended_causes(study, causes)) if kind is VerdictKind.NAMED else (),
        null_p=null_p,
        runner_up=closest,
        rejected=() if confusable else tuple(sorted((rival for rival, _ in rivals), key=lambda rival: rival.behind)),
        follows=(*_odd(study), *_follows(left[:3], names)) if kind is VerdictKind.UNEXPLAINED else (),
        cannot_tell=(*untold(study, causes), *perhaps_absent(fitted, [*causes, *little]), *too_little(little)),
        record_next=tuple(_record_next(study, kind, closest)),
    )
    return JointVerdict(verdict if isinstance(study.robot, KnownTriFinger) else reconsidered(study, verdict), tuple(left))


def _kind(study: JointStudy, causes: Sequence[Cause], left: Sequence[Pattern], *, is_tie: bool) -> tuple[VerdictKind, str]:
    explained = sum(a.gain for a in study.fit.accepted)
    if odd := _odd(study):
        return VerdictKind.UNEXPLAINED, f"No cause of the catalogue explains {odd[0]}."
    if isinstance(study.robot, KnownTriFinger) and len(_large_scales(causes)) >= _TRADED:
        said = "Only torques or masses of several joints that are far off would explain the data: no cause of the catalogue does."
        return VerdictKind.UNEXPLAINED, said
    is_stuck = any(f.sign is Sign.REST_UNDER_LOAD for f in study.findings)
    share = study.robot.pattern_share if study.problem.expects_many else study.robot.pattern_share_of_few
    if strongest_left(study, left) > max(PATTERN_NATS, study.robot.healthy.left_nats, share * explained) and not is_stuck:
        return VerdictKind.UNEXPLAINED, "The data disagree with the model, and no cause of the catalogue explains it well enough."
    if not causes:
        return _without_causes(study)
    if is_tie and not study.problem.expects_many:  # among many causes each has a proxy for a moment
        return VerdictKind.CONFUSABLE, "Some cause explains the data, but these data cannot tell which of those that are listed."
    return _named(study, [cause for cause in causes if is_clear(study, cause)])


def _without_causes(study: JointStudy) -> tuple[VerdictKind, str]:
    if isinstance(study.robot, KnownTriFinger) and study.fit.accepted:
        said = " and ".join(sorted({accepted.effect.replace("_", " ") for accepted in study.fit.accepted}))
        summary = f"The data disagree with the model; {said} would explain a part of it, but at no joint clearly."
        return VerdictKind.UNEXPLAINED, summary
    return VerdictKind.NOTHING_WRONG, "The data agree with the model as well as a healthy robot's would."


def strongest_left(study: JointStudy, left: Sequence[Pattern]) -> float:
    """What is left for any function of one variable, or for a hypothesis whose values no robot has, nats."""
    noisy = {f.joint for f in study.findings if f.sign in SENSOR_NOISE | FELT and _is_shown(f, study)}
    factor = 1.0 if study.problem.expects_many else _VELOCITY_FACTOR
    clear, explained = _almost_explained(study), sum(a.gain for a in study.fit.accepted)
    most = _SHAPE * explained if isinstance(study.robot, KnownTriFinger) else np.inf
    told = [
        p for p in left if p.joint not in noisy and not (p.channel is Channel.MECHANICS and p.joint in clear and p.gain < most)
    ]
    strongest = max((p.gain / (factor if p.channel is Channel.VELOCITY else 1.0) for p in told), default=0.0)
    if isinstance(study.robot, UnknownRobot):
        return strongest
    return max(strongest, _beyond_bounds(study))


def _named(study: JointStudy, clear: Sequence[Cause]) -> tuple[VerdictKind, str]:
    if not clear:
        return VerdictKind.UNEXPLAINED, "Many causes act together, and none of them is clear by itself."
    if is_too_little(study, clear):
        said = f"{', '.join(told(clear)).capitalize()} would explain the data, but what is smaller than a detection limit"
        return VerdictKind.UNEXPLAINED, f"{said} is often another cause in disguise."
    return VerdictKind.NAMED, f"The data disagree with the model because of {', '.join(told(clear))}."


def _almost_explained(study: JointStudy) -> set[int]:
    """Joints whose held-out torque error is almost gone: what is left of it is the shape of a law, however clear it is."""
    if not study.fit.accepted:
        return set()
    before, after = errors_of(study.problem, study.start).by_joint_nm, held_out_errors(study.problem, study.fit.last).by_joint_nm
    return set(np.flatnonzero(after < (1.0 - ALMOST) * before).tolist())


def _odd(study: JointStudy) -> list[str]:
    """What no healthy robot shows and no cause of the catalogue explains."""
    shown = [f for f in study.odd if _is_shown(f, study)]
    return [f"{f.sign} of {place(study.problem.names, f.joint)}" for f in shown]


def _may_have_play(study: JointStudy) -> bool:
    """Whether so much is left as play in several gears leaves, whose law here does not follow a rotor that hits its end."""
    look = study.fit.last
    is_single = isinstance(study.robot, KnownTriFinger) and not study.problem.expects_many
    return is_single and look.mechanics_left > _LEFT_BY_PLAY * look.mechanics_rows


def _beyond_bounds(study: JointStudy) -> float:
    """What the best hypothesis still gains whose values no robot has, nats: something acts where it does.

    Not of effects that were found without a fit: at other joints it is the shape of their law. And not what one moment tells, as
    far as folds are stretches and no whole recordings.
    """
    found = {f.effect for f in study.findings}
    refused = [c for c in study.fit.last.candidates if not c.allowed and c.hypothesis.effect not in found]
    if len(study.problem.episodes) >= WHOLE_EPISODES:
        return max((c.gain for c in refused), default=0.0)
    least = (c.gain - float((c.by_fold + np.roll(c.by_fold, 1)).max()) for c in refused)
    return max((lasting(c.gain, left) for c, left in zip(refused, least, strict=True)), default=0.0)


def _large_scales(causes: Sequence[Cause]) -> list[Cause]:
    return [
        cause
        for cause in causes
        if scales_everything(cause.effect)
        and abs(cause.value - PARAMETERS[f"{cause.effect}.{cause.parameter}"].absent) > _TRADED_SCALE
    ]


def _found(finding: Finding, names: tuple[str, ...]) -> Cause:
    where = place(names, finding.joint)
    unit = PARAMETERS[f"{finding.effect}.{finding.parameter}"].unit
    return Cause(finding.effect, finding.parameter, where, finding.value, unit, finding.interval_90)


def _is_shown(finding: Finding, study: JointStudy) -> bool:
    """Not what another cause leaves, which looks like noise, and holds a joint where it should not be.

    A cause that is too little to be one leaves none. Of a robot that nobody knows only readings are asked for noise, and no
    cause of motion makes them white.
    """
    where = place(study.problem.names, finding.joint)
    if finding.sign not in SENSOR_NOISE | FELT | ENDS or isinstance(study.robot, UnknownRobot):
        return True
    same = (where.partition("_")[0] if finding.sign in ENDS else where, "platform", "all")
    others = [
        a
        for a in study.fit.accepted
        if a.where.startswith(same) and not (finding.sign is Sign.VELOCITY_NOISE and _is_of_noise(a))
    ]
    return all(own and is_too_little(study, own) for own in (causes_of(study, a) for a in others))


def _is_of_noise(accepted: Accepted) -> bool:
    """Whether a cause of reported velocities alone is no more than noise makes of one: no filter makes noise."""
    return FITTED[accepted.effect].channel is Channel.VELOCITY and accepted.gain < PATTERN_NATS


def _filtered_noise(causes: Sequence[Cause], study: JointStudy) -> list[Cause]:
    """Causes of a TriFinger that are no more than the noise of reported velocities, which is told itself."""
    if isinstance(study.robot, UnknownRobot):
        return []
    noisy = {place(study.problem.names, f.joint) for f in study.findings if f.sign is Sign.VELOCITY_NOISE}
    taken = {(a.effect, a.where) for a in study.fit.accepted if _is_of_noise(a) and a.where in noisy}
    return [cause for cause in causes if (cause.effect, cause.where) in taken]


def _is_bent(accepted: Accepted, robot: Robot) -> bool:
    """Whether a cause is asked along a straight line that it does not follow; of other robots simulated motions tell."""
    return isinstance(robot, KnownTriFinger) and FITTED[accepted.effect].is_bent


def _tie_nats(accepted: Accepted, robot: Robot) -> float:
    """How far behind a rival is as good."""
    return max(CONFUSABLE_NATS, BENT_TIE * accepted.gain) if _is_bent(accepted, robot) else CONFUSABLE_NATS


def _rival(study: JointStudy, accepted: Accepted) -> tuple[Rival, list[Cause]] | None:
    """The best other hypothesis where a cause was taken, with what it would have said.

    All joints together are no rival of a single one, since they contain what it is, and neither is another joint with the same
    effect, but where its image is no straight line.
    """
    look, is_single = study.fit.looks[accepted.look], accepted.where != ALL_JOINTS
    taken = next((c for c in look.candidates if c.hypothesis.name == (accepted.effect, accepted.where)), None)
    if taken is None:
        return None
    refuted = study.fit.refused if isinstance(study.robot, UnknownRobot) else study.fit.fallen
    later = {(a.effect, a.where) for a in study.fit.accepted} | refuted
    for candidate in look.candidates:
        h = candidate.hypothesis
        is_next_door = is_single and h.where != accepted.where and _is_bent(accepted, study.robot)
        is_same = h.effect == accepted.effect and not is_next_door
        if not candidate.allowed or h.name in later or is_same or (is_single and h.where == ALL_JOINTS):
            continue
        if candidate.gain > taken.gain and isinstance(study.robot, UnknownRobot):
            continue  # passed over when the cause was taken, so that it is no tie
        if candidate.gain < _gate(study, h.effect) and not _explains_away(study, look, candidate, taken):
            continue  # by itself it would not be named either
        if study.problem.expects_many and (candidate.gain > taken.gain or h.effect in {a.effect for a in study.fit.accepted}):
            continue  # refused for its values, or named elsewhere
        if FITTED[h.effect].contains == accepted.effect:
            continue  # the same with one number more
        rival = Rival(
            h.effect,
            h.where,
            float(taken.gain - candidate.gain),
            separated_by(h.effect, accepted.effect, "a longer and livelier recording"),
        )
        return rival, _rival_causes(look, candidate, study)
    return None


def _gate(study: JointStudy, effect: str) -> float:
    """What a cause must gain to be named, nats."""
    return study.gates.get(effect, study.gate)


def _explains_away(study: JointStudy, look: Look, candidate: Candidate, taken: Candidate) -> bool:
    """Whether a hypothesis explains more than a cause that was taken, which beside it would not be named any more.

    It need not be more than healthy sessions show of it: then what was taken is no more either.
    """
    if candidate.gain <= taken.gain:
        return False
    both = (*candidate.hypothesis.terms, *taken.hypothesis.terms)
    beside = look.rest.gain(both, (*candidate.hypothesis.scales, *taken.hypothesis.scales)) - candidate.gain
    return beside < _gate(study, taken.hypothesis.effect)


def _rival_causes(look: Look, candidate: Candidate, study: JointStudy) -> list[Cause]:
    terms = tuple(look.catalogue.terms[index] for index in candidate.hypothesis.terms)
    found = []
    for fitted in fitted_values(study.start, moved(look.state, terms, candidate.values), terms, candidate.errors):
        parameter, half = PARAMETERS[fitted.key], Z_90 * fitted.error
        where = place_of(study.problem.names, fitted, candidate.hypothesis.where)
        interval = (fitted.value - half, fitted.value + half)
        found.append(Cause(candidate.hypothesis.effect, parameter.name, where, fitted.value, parameter.unit, interval))
    return found


def _follows(found: Sequence[Pattern], names: tuple[str, ...]) -> list[str]:
    """What is left follows these; what healthy sessions have, too, is nothing that it follows."""
    return [f"{p.variable} of {names[p.joint]} ({p.channel} equation, {p.gain:.0f} nats)" for p in found if p.gain > PATTERN_NATS]


def _record_next(study: JointStudy, kind: VerdictKind, closest: Rival | None) -> list[str]:
    if kind is VerdictKind.CONFUSABLE and closest is not None:
        return [closest.separated_by]
    if kind is VerdictKind.UNEXPLAINED and _may_have_play(study):
        play = effect_of(Sign.RATTLING_ROTOR)
        return [f"each joint turned by hand to and fro, its motor held: as much is left as play in several gears leaves ({play})"]
    if kind is VerdictKind.UNEXPLAINED:
        return ["the same motion twice, slowly and fast, to see whether what is left repeats"]
    return []
