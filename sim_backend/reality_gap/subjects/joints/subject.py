"""Joints as a subject: equations along the recorded motion, causes that explain what they leave, and the verdict on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.joint_effects import ARMATURE
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.recording import Recording, RecordingError
from sim_backend.reality_gap.subjects.joints.gain import held_out, held_out_of_hits
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, ShowsNothingError, joints_of, study_joints
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import with_controllers, without_play
from sim_backend.reality_gap.subjects.joints.laws.motor_law import LIMIT
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots
from sim_backend.reality_gap.subjects.joints.rollouts.limits import enough_of, limits_of
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import FAR_OFF, LENGTHS_S, RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import select_by_rollouts
from sim_backend.reality_gap.subjects.joints.sections import joint_sections
from sim_backend.reality_gap.subjects.joints.signs.commanded_and_measured import causes_between
from sim_backend.reality_gap.subjects.joints.signs.position_and_velocity import causes_of_velocities
from sim_backend.reality_gap.subjects.joints.signs.standing_readings import against_standing_readings
from sim_backend.reality_gap.subjects.joints.slides import Slides
from sim_backend.reality_gap.subjects.joints.torques.calibrating import METHODS, calibrate
from sim_backend.reality_gap.subjects.joints.torques.contradictions import contradicts
from sim_backend.reality_gap.subjects.joints.verdicts.equal_causes import (
    with_late_columns,
    with_share_of_all,
    with_turned_base,
    with_weight,
)
from sim_backend.reality_gap.subjects.joints.verdicts.filtered_loops import without_loops_of_filters
from sim_backend.reality_gap.subjects.joints.verdicts.judged import not_judged
from sim_backend.reality_gap.subjects.joints.verdicts.needed_causes import with_needed_causes
from sim_backend.reality_gap.subjects.joints.verdicts.stated_dampings import (
    are_asked_for_torques,
    braking_dampings,
    perhaps_other_damping,
)
from sim_backend.reality_gap.subjects.joints.verdicts.swings import perhaps_another_pace, perhaps_less_inertia
from sim_backend.reality_gap.subjects.joints.verdicts.torques_and_rollouts import (
    in_both,
    of_smoothed,
    proposed_by,
    with_unlike_torques,
)
from sim_backend.reality_gap.subjects.joints.verdicts.unnamed_patterns import against_patterns
from sim_backend.reality_gap.subjects.joints.verdicts.unnamed_rivals import against_unnamed
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_rollouts import verdict_of_rollouts
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_unknown_robot import sensors_of_two
from sim_backend.reality_gap.subjects.joints.verdicts.weak_motors import against_weak_motors, perhaps_a_weak_supply
from sim_backend.reality_gap.subjects.joints.verdicts.wording import listed
from sim_backend.reality_gap.subjects.subject import CUBE_EXCITATION, Material, Progress, Sections, part
from sim_backend.reality_gap.verdict import Cause, Doubt, Verdict, VerdictKind
from sim_backend.trifinger.scene import compile_scene

NAMING, ROLLOUTS, TORQUES = METHODS[:3]


def seen_in(material: Material) -> tuple[Recording, ...]:
    """Recordings with joints that nothing but their motors moves."""
    return tuple(r for r in material.recordings if r.joints is not None and r.regime != CUBE_EXCITATION)


def study(material: Material, known: Robot, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, Sections]:
    """As of any :class:`Subject`."""
    recordings = seen_in(material)
    if material.method in (ROLLOUTS, TORQUES) and isinstance(known, KnownTriFinger):
        raise RecordingError(
            f"--method {material.method} is for recordings of a study.toml; logs of the farm are judged by naming"
        )
    model = compile_scene() if material.study_file is None else material.study_file.compile_model()
    slides, nominal = Slides.of(model, joints_of(recordings)), _nominal(material, recordings)
    if slides.slide.any():
        model, recordings = slides.model_as_hinges(model), tuple(map(slides.as_hinges, recordings))
        nominal = slides.values_as_hinges(nominal)
    verdict, sections = _studied(model, recordings, nominal, known, material.method, rng, progress)
    return slides.in_metres(verdict), sections


def _studied(
    model: mujoco.MjModel,
    recordings: Sequence[Recording],
    nominal: Mapping[str, np.ndarray],
    known: Robot,
    method: str,
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[Verdict, Sections]:
    """Of joints that are hinges, or counted like them."""
    try:
        found = study_joints(  # replay, residual, fit
            model,
            recordings,
            progress,
            robot=known,
            nominal=nominal,
            gate=None if method in (NAMING, ROLLOUTS, TORQUES) else np.inf,
        )
    except ShowsNothingError as error:
        return not_identifiable(error, known), {}
    if method not in (NAMING, ROLLOUTS, TORQUES):
        return _calibrated(found, method, rng), {}
    judged = judge(found)
    verdict = _with_gain(found, judged.verdict, rng)
    if isinstance(known, UnknownRobot) and method != TORQUES:
        verdict = _rolled_out(found, verdict, method, rng, progress)
    progress("drawing what is left", 0.9)
    return verdict, joint_sections(found, judged.patterns, rng)


def _rolled_out(found: JointStudy, torques: Verdict, method: str, rng: np.random.Generator, progress: Progress) -> Verdict:
    """What makes the model go where the robot went, alone or with what torques say beside it.

    Args:
        found: the study of the same recordings by torques.
        torques: its verdict.
        method: ``NAMING`` or ``ROLLOUTS``.
        rng: draws healthy robots.
        progress: told what is done, and which share.
    """
    assert isinstance(found.robot, UnknownRobot)
    catalogue = without_play(found.fit.first.catalogue, found.start.value(ARMATURE) > 0.0)
    catalogue = with_controllers(catalogue, found.problem.names, _unrecorded_controllers(found))
    problem = RolloutProblem(found.problem.episodes, found.start, catalogue, found.robot.tolerance)
    if not len(problem.windows):
        return _not_simulated(found, torques)

    def is_possible(state: JointState) -> bool:
        return not contradicts(found.problem, state)

    progress("simulating healthy robots", 0.2)
    robots, enough = DrawnRobots(problem, rng), enough_of(problem)

    def is_healthy(fit: RolloutFit) -> bool:
        return limits_of(robots, fit, enough, part(progress, 0.5, 0.55)).hold(fit)

    proposed = proposed_by(torques, found) if method == NAMING else {}
    selection = select_by_rollouts(
        problem,
        catalogue,
        is_possible,
        part(progress, 0.2, 0.8),
        proposed,
        healthy_rad=robots.coarse.fitted_rad,
        enough_rad=enough.usual_rad,
        is_healthy=is_healthy,
    )
    healthy = limits_of(robots, selection.nominal, enough, part(progress, 0.8, 0.85))
    is_left, near = selection.taken and not selection.problem.is_near_noise(selection.fit), part(progress, 0.85, 0.9)
    others = DrawnRobots(selection.problem, rng, around=selection.fit) if is_left else robots
    selection = with_needed_causes(selection, lambda fit: limits_of(others, fit, enough, near), is_possible)
    with_causes = limits_of(others, selection.fit, enough, near)
    rollouts = verdict_of_rollouts(found, selection, healthy, with_causes)
    drawn_rad = np.maximum(FAR_OFF * problem.noise_rad, with_causes.drawn_rad)
    rollouts = against_patterns(rollouts, found, selection, drawn_rad)
    rollouts = against_unnamed(rollouts, selection, with_causes.usual_rad)
    is_driven = _are_driven(found)
    rollouts = against_weak_motors(rollouts, found, selection, is_driven)
    rollouts = with_share_of_all(rollouts, found.problem.names, is_driven, found.robot.tolerance.mass)
    rollouts = with_late_columns(rollouts)
    plant, state = found.problem.episodes[0].plant, selection.fit.state
    rollouts = with_turned_base(with_weight(rollouts, plant, state), plant, state)
    verdict = _with_torques(found, torques, rollouts) if method == NAMING else rollouts
    return against_standing_readings(verdict, found.problem.episodes, found.problem.names)


def _with_torques(found: JointStudy, torques: Verdict, rollouts: Verdict) -> Verdict:
    """What rollouts say, with what torques, and columns beside each other, say of sensors."""
    between = causes_between(found.problem.episodes, found.problem.names)
    of_velocities, perhaps, left_open = causes_of_velocities(found.problem.episodes, found.problem.names)
    damping = np.where(_unrecorded_controllers(found), _damping_of_controllers(found), np.nan)
    late = [*of_velocities, *perhaps]
    rollouts = without_loops_of_filters(rollouts, late, found.problem.names, found.start.value(ARMATURE), damping)

    def nominal(cause: Cause) -> float:
        return found.problem_start(f"{cause.effect}.{cause.parameter}", found.problem.names.index(cause.where))

    late_columns = of_smoothed(rollouts.causes, between.smoothed, nominal)
    swings = [*perhaps_less_inertia(found, rollouts.causes), *perhaps_another_pace(found, rollouts.causes)]
    driving = perhaps_a_weak_supply(found, rollouts.causes, _are_driven(found))
    driving += _perhaps_other_damping(found, rollouts.causes, nominal)
    doubts = [*between.doubts, *late_columns, *sensors_of_two(found, torques.causes), *swings, *driving]
    unlike = [*between.unlike, *_unlike_laws(found)]
    both = with_unlike_torques(in_both(torques, rollouts, [*between.causes, *of_velocities], doubts), unlike)
    return replace(both, cannot_tell=(*both.cannot_tell, *between.open, *left_open))


def _are_driven(found: JointStudy) -> list[bool]:
    """Whether a torque drives each joint."""
    return np.any([(episode.driving_nm != 0.0).any(axis=1) for episode in found.problem.episodes], axis=0).tolist()


def _unrecorded_controllers(found: JointStudy) -> np.ndarray:
    """Joints that a stated controller drives while nobody recorded what it sent, shape (k,)."""
    signals = [episode.path.joints for episode in found.problem.episodes]
    return np.all([[name in each.not_recorded for name in each.names] for each in signals], axis=0)


def _perhaps_other_damping(found: JointStudy, causes: Sequence[Cause], nominal: Callable[[Cause], float]) -> list[Doubt]:
    """Of causes that another damping of a stated controller is instead, where nobody recorded what it sent."""
    paths = [episode.path for episode in found.problem.episodes]
    recorded = [path.joints for path in paths]
    damping = np.where(_unrecorded_controllers(found), braking_dampings(recorded), np.nan)
    row_s, are_asked = max(path.step_s for path in paths), are_asked_for_torques(recorded)
    return perhaps_other_damping(causes, found.problem.names, damping, nominal, row_s, are_asked)


def _unlike_laws(found: JointStudy) -> list[str]:
    """Sentences on measured torques that are not what a stated controller sends, where nobody recorded what it sent."""
    said = []
    for j, name in enumerate(found.problem.names):
        signals = [episode.path.joints for episode in found.problem.episodes]
        sent = [each.commanded_torque_nm for each in signals if each.commanded_torque_nm is not None]
        if name in signals[0].unlike_law and not any(np.isfinite(each[:, j]).any() for each in sent):
            share = signals[0].unlike_law[name]
            said.append(
                f"the measured torque of {name} is {share:.0%} off what its stated controller sends: it has another law, or its "
                "motor is late or limited"
            )
    return said


def _damping_of_controllers(found: JointStudy) -> np.ndarray:
    """Of what is known of the controllers, the median, shape (k,); NaN of joints without one."""
    laws = [law for episode in found.problem.episodes if (law := episode.path.joints.feedback) is not None]
    if not laws:
        return np.full(len(found.problem.names), np.nan)
    return np.asarray(np.median(np.concatenate([law.damping_nm_s_rad for law in laws]), axis=0))


def _not_simulated(found: JointStudy, torques: Verdict) -> Verdict:
    """Recordings without any stretch that could be simulated: what torques would name nobody can confirm."""
    why = f"no recording has {LENGTHS_S[-1]:g} s in which positions and torques of all joints are known"
    has_any = np.any([episode.has_torque for episode in found.problem.episodes], axis=0)
    if without := [name for name, has in zip(found.problem.names, has_any, strict=True) if not has]:
        what = "passive = true says that nothing drives a joint, and one that is held still may be left out of [joints]"
        why += f" (of {listed(without)} no torque is: {what})"
    if torques.verdict not in (VerdictKind.NAMED, VerdictKind.CONFUSABLE):
        return replace(torques, cannot_tell=(f"whether simulated motions agree: {why}", *torques.cannot_tell))
    return replace(
        torques,
        verdict=VerdictKind.NOT_IDENTIFIABLE,
        summary=f"These data cannot tell anything for sure: {why}, so that no motion can be simulated.",
        causes=(),
        record_next=("several seconds at a stretch in which nothing is missing",),
    )


def _with_gain(found: JointStudy, verdict: Verdict, rng: np.random.Generator) -> Verdict:
    """The verdict with what its causes bought, unless data are not as they are told, and with what could not be judged."""
    when = "while they move steadily" if found.is_of_many else "while they move"
    when += " and no rotor hits" if found.rattling else ""
    names = found.problem.names
    verdict = replace(verdict, cannot_tell=(*verdict.cannot_tell, *not_judged(found.problem.episodes, names)))
    if verdict.misreads:
        return verdict
    return replace(
        verdict,
        held_out=held_out(found.problem, found.fit.final, found.start, rng, when=when),
        held_out_there=tuple(held_out_of_hits(each.errors, names[each.joint], rng) for each in found.rattling),
    )


def _calibrated(study: JointStudy, method: str, rng: np.random.Generator) -> Verdict:
    """All numbers at once, by a method that names nothing."""
    result = calibrate(study.problem, study.start, method, rng)
    look = study.problem.look(result.state, ())
    return Verdict(
        verdict=VerdictKind.CALIBRATED,
        summary=f"Calibrated {len(result.causes)} numbers by {method}; reproducing data makes none of them a cause.",
        causes=result.causes,
        held_out=held_out(study.problem, look, study.start, rng),
        cannot_tell=("which of these numbers is a cause: this method changes whatever helps",),
    )


def not_identifiable(error: ShowsNothingError, robot: Robot) -> Verdict:
    """Nothing about joints can be told."""
    what = (
        "run 'trifarm identify --excitation standard' on the robot"
        if isinstance(robot, KnownTriFinger)
        else "move every joint slowly and fast over its range"
    )
    return Verdict(
        verdict=VerdictKind.NOT_IDENTIFIABLE,
        summary=f"These data cannot tell anything: {error}.",
        cannot_tell=(f"every effect of joints: {error.because}",),
        record_next=(f"{what}; 'trifarm gap excite' says how",),
    )


def _nominal(material: Material, recordings: Sequence[Recording]) -> Mapping[str, np.ndarray]:
    """Values to start from that a study file states for joints' effects; NaN for the limits of motors that it does not name."""
    if material.study_file is None:
        return {}
    names, found = recordings[0].joints.names if recordings[0].joints is not None else (), {}
    for key, value in material.study_file.nominal.items():
        parameter = PARAMETERS[key]
        if parameter.scope is Scope.JOINT:
            by_joint = value if isinstance(value, Mapping) else dict.fromkeys(names, value)
            absent = np.nan if key == LIMIT else parameter.absent  # a TriFinger's limit is no other robot's
            found[key] = np.array([float(by_joint.get(name, absent)) for name in names])  # pyrefly: ignore[bad-argument-type]
        else:
            found[key] = np.atleast_1d(np.asarray(value, dtype=float))
    return found
