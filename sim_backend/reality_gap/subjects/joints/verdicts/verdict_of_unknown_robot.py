"""What a verdict on a robot without healthy sessions must still answer: was each joint judged, and is what is left explained?

A gain says that a cause explains something, not that it explains what is wrong. Where healthy sessions are known their gains tell
both apart. Here the held-out torque error of each joint is compared with the noise of its sensors instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import FITTED, Channel, Sign, effect_of
from sim_backend.reality_gap.subjects.joints.gain import errors_of, held_out_errors
from sim_backend.reality_gap.subjects.joints.identification import LEAST_TORQUE_SHARE, JointStudy
from sim_backend.reality_gap.subjects.joints.signs.checks import noise_of_clocks
from sim_backend.reality_gap.subjects.joints.slides import told_distance, told_torque
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import least_s
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import shares
from sim_backend.reality_gap.subjects.joints.verdicts.misreadings import misreading
from sim_backend.reality_gap.subjects.joints.verdicts.near_ends import mostly_at_ends, sentences_on_ends
from sim_backend.reality_gap.subjects.joints.verdicts.readings import all_rows, told_by
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import without_sign
from sim_backend.reality_gap.subjects.joints.verdicts.wording import listed
from sim_backend.reality_gap.verdict import Cause, Doubt, Verdict, VerdictKind

FAR = 2.0
"""Times the noise: sensors are seldom as white as their floor takes for granted, but not by more."""
LEAST_OF_LEFT = 0.5
"""A cause that took less than this of what it leaves (root mean squares) is a footnote to something larger."""
LAW_SHARE = 0.5
"""Of the variance of what is left: a function of one variable that takes more is a law that the catalogue lacks."""
ALMOST = 0.7
"""Where so much of the held-out error is gone, what is left is the shape of a law and not another cause."""


@dataclass(frozen=True)
class Agreement:
    """How each joint agrees with its model; shapes (k,), N m.

    Attributes:
        is_judged: whether a joint had equations at all.
        before, after: held-out torque error with the nominal model and with the causes.
        noise: what sensors, the integration of motion and a model as inexact as this one may be make of it.
    """

    is_judged: np.ndarray
    before: np.ndarray
    after: np.ndarray
    noise: np.ndarray

    @property
    def is_far(self) -> np.ndarray:
        """Joints that were judged and disagree far beyond noise, causes or not."""
        return self.is_judged & (self.after > FAR * self.noise)

    @property
    def was_far(self) -> np.ndarray:
        """Joints that were judged and disagreed with the nominal model."""
        return self.is_judged & (self.before > FAR * self.noise)

    @property
    def was_off(self) -> np.ndarray:
        """The same, of joints with too few rows to be judged, too; rows enough for signs and units to show."""
        return self.before > FAR * self.noise

    @property
    def is_footnote(self) -> np.ndarray:
        """Joints at which far more is left than what the causes took."""
        taken = np.sqrt(np.maximum(self.before**2 - self.after**2, 0.0))
        return self.is_far & (taken < LEAST_OF_LEFT * self.after)


def agreement_of(study: JointStudy) -> Agreement:
    """Compare each joint's errors with its noise."""
    problem = study.problem
    floor = np.sqrt(np.mean([e.torque_error_floor_nm**2 for e in problem.episodes], axis=0))
    before, after = errors_of(problem, study.start).by_joint_nm, held_out_errors(problem, study.fit.final).by_joint_nm
    usual = np.hypot(LEAST_TORQUE_SHARE * problem.torque_rms_nm, study.fit.first.tolerated_nm)
    return Agreement(study.is_judged, before, after, np.hypot(floor, usual))


def unknown_of(study: JointStudy) -> list[str]:
    """What no recording of a robot tells whose sensors, motors and other joints nobody knows."""
    episodes = study.problem.episodes
    said = ["anything about ends of joints and noise of torques: what is usual for this robot is not known"]
    row_ms = 1e3 * max(e.path.step_s for e in episodes)
    said.append(f"delays below a row ({row_ms:.3g} ms): nobody says when within its row a torque acted")
    if any(e.path.joints.measured_torque_nm is not None and e.path.joints.commanded_torque_nm is not None for e in episodes):
        said.append("the constant of motors, and delays of less than a row: the mechanics is compared with the measured torque")
    said += [*_sensors_alone(study), *_of_rows(study), *sentences_on_ends(episodes, study.problem.names)]
    if resting := episodes[0].plant.resting:
        said.append(f"anything about {listed(resting)}: not recorded, and taken to rest where the model has it at first")
    return said


def _sensors_alone(study: JointStudy) -> list[str]:
    """Of joints that are the only hinge or the only slide: with nothing to compare them with no sensor is odd."""
    episodes, said = study.problem.episodes, []
    is_slide = episodes[0].plant.is_slide
    for j, name in enumerate(study.problem.names):
        if (is_slide == is_slide[j]).sum() > 1:
            continue
        step_rad = max(float(e.path.encoder_step_rad[j]) for e in episodes)
        size = told_distance(step_rad, is_slide=bool(is_slide[j]), digits=3)
        steps = f" (its positions come in steps of {size})" if step_rad > 0.0 else ""
        said.append(f"whether sensors of {name} are coarser or noisier than usual{steps}: no other joint to compare with")
    return said


def sensors_of_two(study: JointStudy, causes: Sequence[Cause]) -> list[Doubt]:
    """Of sensors that are odd beside a single joint of their kind: the two may have been built with different ones.

    Args:
        study: of an unknown robot.
        causes: that torques and readings show.
    """
    names, is_slide, doubts = study.problem.names, study.problem.episodes[0].plant.is_slide, []
    of_sensors = {effect_of(sign) for sign in (Sign.POSITION_STEPS, Sign.POSITION_NOISE, Sign.VELOCITY_NOISE)}
    for cause in causes:
        if cause.effect not in of_sensors or cause.where not in names:
            continue
        j = names.index(cause.where)
        others = [name for i, name in enumerate(names) if i != j and is_slide[i] == is_slide[j]]
        if len(others) == 1:
            how = "coarser" if cause.effect == effect_of(Sign.POSITION_STEPS) else "noisier"
            said = f"{cause.where} was built with a {how} sensor than {others[0]}, the only joint to compare it with"
            doubts.append(Doubt(cause, said, f"nothing: look at the data sheets of both sensors, {cause.where} and {others[0]}"))
    return doubts


def _of_rows(study: JointStudy) -> list[str]:
    """Of tables whose rows seem to be missing or taken at other times than they say, and of controllers unlike their law."""
    names, episodes, said = study.problem.names, study.problem.episodes, []
    for episode in episodes:
        joints, name = episode.path.joints, episode.path.recording.name
        if joints.torn_s:
            when = ", ".join(f"{at_s:.3f}" for at_s in joints.torn_s)
            said.append(f"what happened in {name} at {when} s: joints jump there at once, as where rows are missing")
    for joint, share in episodes[0].path.joints.unlike_law.items():
        said.append(
            f"whether the controller of {joint} is as stated: what it would send is {share:.0%} off the recorded torque, which "
            "was taken instead"
        )
    for j, level_rad in noise_of_clocks(episodes).items():
        size = told_distance(level_rad, is_slide=bool(episodes[0].plant.is_slide[j]))
        said.append(
            f"whether the encoder of {names[j]} is noisy: what is white of its positions, {size}, grows with the speed, "
            "as where the times of rows are not exact"
        )
    return said


def reconsidered(study: JointStudy, verdict: Verdict) -> Verdict:
    """A verdict as it stands when what is left of the error is looked at, with what it cannot tell of the joints."""
    agreement, names, is_slide = agreement_of(study), study.problem.names, study.problem.episodes[0].plant.is_slide
    unjudged = [name for name, judged in zip(names, agreement.is_judged, strict=True) if not judged]
    verdict = replace(verdict, cannot_tell=(*verdict.cannot_tell, *_unjudged_sentences(study, unjudged)))
    if any(finding.sign is Sign.REST_UNDER_LOAD for finding in study.findings):
        return verdict
    if agreement.was_off.any() and (misread := _misread(study, agreement, verdict)) is not None:
        return misread
    if not agreement.is_judged.any():
        rows = "enough rows in which it moves, away from the ends of its range, and everything was measured"
        has_torque = np.any([episode.has_torque for episode in study.problem.episodes], axis=0)
        few = ", ".join(f"{name} {_lasting(study, j)}" for j, name in enumerate(names) if has_torque[j])
        counted = f" ({few})" if few else ""
        return _not_identifiable(study, verdict, f"These data cannot tell anything: of no joint are there {rows}{counted}.")
    if (why := _objection(study, agreement, verdict.causes)) is not None:
        followed = tuple(f"{variable} of {names[j]} ({share:.0%} of it)" for j, variable, share in _laws(study, agreement))
        return replace(_unexplained(verdict, why), follows=(*followed, *verdict.follows))
    if verdict.verdict is VerdictKind.NOTHING_WRONG and unjudged:
        return _not_identifiable(study, verdict, f"What could be judged agrees with the model; {listed(unjudged)} could not.")
    return replace(verdict, cannot_tell=(*verdict.cannot_tell, *_left_sentences(agreement, names, is_slide)))


def _objection(study: JointStudy, agreement: Agreement, causes: Sequence[Cause]) -> str | None:
    """Why what was named, or that nothing was, does not explain the data; None if it does."""
    named = {(cause.effect, cause.where) for cause in causes}
    accepted = [a for a in study.fit.accepted if _is_among(a, named, study)]
    if not accepted and agreement.was_far.any():
        worst = _worst(agreement, agreement.before, study)
        return f"The data disagree with the model, {worst}, and no cause of the catalogue explains it."
    footnotes = [a for a in accepted if all(agreement.is_footnote[j] for j in _joints_of(a, len(agreement.noise)))]
    if footnotes:
        worst, what = _worst(agreement, agreement.after, study), footnotes[0].effect.replace("_", " ")
        return f"What no cause explains is far larger than what {what} explains: {worst}."
    if laws := _laws(study, agreement):
        worst, where = _worst(agreement, agreement.after, study), study.problem.names[laws[0][0]]
        law = f"at {where} this follows the {laws[0][1]}, by a law that the catalogue lacks"
        return f"With the causes the torques are still off, {worst}; {law}."
    return None


def _is_among(accepted: Accepted, named: set[tuple[str, str]], study: JointStudy) -> bool:
    """Whether a cause that was accepted has any number that matters."""
    places = {accepted.where, *"xyz", *(study.problem.names[t.index] for t in accepted.terms if PARAMETERS[t.key].width == 9)}
    return any(effect == accepted.effect and where in places for effect, where in named)


def _joints_of(accepted: Accepted, joints: int) -> list[int]:
    """Where a cause acts first: its own joints, or all of them."""
    reaches = FITTED[accepted.effect].reaches_other_joints
    own = sorted({t.index for t in accepted.terms if PARAMETERS[t.key].width == 9 and not reaches})
    return own or list(range(joints))


def _laws(study: JointStudy, agreement: Agreement) -> list[tuple[int, str, float]]:
    """Joints at which what is left follows one variable: index, variable and share, the largest share first."""
    open_ = agreement.is_far & (agreement.after > (1.0 - ALMOST) * agreement.before)
    found = []
    for j in np.flatnonzero(open_):
        variable, share = max(shares(study.problem.episodes, study.fit.state, int(j)).items(), key=lambda item: item[1])
        if share > LAW_SHARE:
            found.append((int(j), variable, share))
    return sorted(found, key=lambda law: -law[2])


def _misread(study: JointStudy, agreement: Agreement, verdict: Verdict) -> Verdict | None:
    """What is said where the data are not as they are told: whatever was fitted took over a part of that. None if they are."""
    names = study.problem.names
    rows = all_rows([told_by(episode, study.start) for episode in study.problem.episodes])
    one_sided, are_few = without_sign(rows), not agreement.is_judged.any()
    if are_few and one_sided:
        return None  # of so few rows on one side nobody knows whether they lost their sign, or have the other one
    if unsigned := [names[j] for j in one_sided if agreement.was_far[j]]:
        who = listed(unsigned)
        why = (
            f"The torques of {who} never change their sign; with the signs that the motion asks for the model agrees far better."
        )
        said, follows, check = f"the torques of {who} are sizes without a sign", (), f"what the torques of {who} hold"
    else:
        left = agreement.after if verdict.causes else np.full(len(agreement.after), np.inf)
        found = misreading(study.problem.episodes, study.start, names, left, with_clocks=not are_few)
        if found is None:
            return None
        said, follows, check = found.said, (found.said,), f"{found.check} in study.toml and in whatever wrote the data"
        why = f"The model agrees far better with the data if {said}."
    return replace(
        _unexplained(verdict, why),
        causes=(),
        runner_up=None,
        rejected=(),
        misreads=said,
        follows=(*follows, *verdict.follows),
        record_next=(f"nothing yet: check {check}",),
    )


def _worst(agreement: Agreement, error_nm: np.ndarray, study: JointStudy) -> str:
    """The joint that is off by most, in units of its noise."""
    times = np.where(agreement.is_judged, error_nm / np.maximum(agreement.noise, 1e-12), 0.0)
    j = int(np.argmax(times))
    much = told_torque(error_nm[j], is_slide=bool(study.problem.episodes[0].plant.is_slide[j]))
    return f"by {much} at {study.problem.names[j]}, {times[j]:.0f} times what sensors and smoothing make"


def _unjudged_sentences(study: JointStudy, unjudged: Sequence[str]) -> list[str]:
    """Of each joint without equations that it has none, and whether its motor pressed in vain."""
    said = []
    for name in unjudged:
        j = study.problem.names.index(name)
        if not any(e.has_torque[j] for e in study.problem.episodes):
            continue  # whose torque nobody knows is said of it elsewhere
        pushes = [np.abs(e.pressing_nm[e.path.valid[:, j], j]) for e in study.problem.episodes]
        pressed = float(np.quantile(np.concatenate(pushes), 0.9)) if sum(map(len, pushes)) else 0.0
        is_driven = any(np.nan_to_num(e.acting_nm[j]).any() for e in study.problem.episodes)
        presses = is_driven and pressed > _needless_nm(study, j)
        gave = told_torque(pressed, is_slide=bool(study.problem.episodes[0].plant.is_slide[j]))
        more = f"; its motor gave {gave} that the model does not need" if presses else ""
        said.append(
            f"anything about {name} by its torques: too few rows in which it moves, away from its ends, and everything was "
            f"measured ({_lasting(study, j)}){more}"
        )
    return said


def _lasting(study: JointStudy, joint: int) -> str:
    """How long the rows of a joint last that count, and how long they would have to."""
    found = [equation for episode in study.problem.episodes for equation in episode.equations(study.start, ())]
    own = [equation for equation in found if equation.channel is Channel.MECHANICS and equation.joint == joint]
    has_s = sum(equation.counted_s for equation in own)
    return f"{has_s:.2g} s of at least {max(map(least_s, own)):.2g} s"


def _needless_nm(study: JointStudy, joint: int) -> float:
    return FAR * max(LEAST_TORQUE_SHARE * float(study.problem.torque_rms_nm[joint]), 1e-12)


def _left_sentences(agreement: Agreement, names: Sequence[str], is_slide: np.ndarray) -> list[str]:
    """What is left beyond noise and was not named."""
    said = []
    for j in map(int, np.flatnonzero(agreement.is_far)):
        times = f"{agreement.after[j] / max(agreement.noise[j], 1e-12):.0f} times what sensors and smoothing make"
        much = told_torque(agreement.after[j], is_slide=bool(is_slide[j]))
        said.append(f"where the {much} come from that the causes leave at {names[j]}: {times}")
    return said


def _unexplained(verdict: Verdict, summary: str) -> Verdict:
    again = ("the same motion twice, slowly and fast, to see whether what is left repeats",)
    return replace(
        verdict, verdict=VerdictKind.UNEXPLAINED, summary=summary, rejected=(), record_next=verdict.record_next or again
    )


def _not_identifiable(study: JointStudy, verdict: Verdict, summary: str) -> Verdict:
    record_next = "every joint over its range, slowly and fast, for ten seconds or more; 'trifarm gap excite' says how"
    if at_ends := mostly_at_ends(study.problem.episodes, study.problem.names):
        record_next = (
            f"nothing yet: check the range of {listed(at_ends)} in the MJCF (in degrees unless its compiler says radian), "
            "and position_unit and zero in study.toml"
        )
    return replace(verdict, verdict=VerdictKind.NOT_IDENTIFIABLE, summary=summary, record_next=(record_next,))
