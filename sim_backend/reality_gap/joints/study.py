"""Joints: from recordings to a verdict about what the model gets wrong."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim_backend.reality_gap.joints.checks import (
    Finding,
    end_findings,
    fault_findings,
    noise_findings,
    noisy_motors,
    torque_noise_findings,
)
from sim_backend.reality_gap.joints.command_lateness import with_measured_lateness
from sim_backend.reality_gap.joints.equations import EpisodeEquations
from sim_backend.reality_gap.joints.fit import MANY_CAUSES, JointFit, select
from sim_backend.reality_gap.joints.gain import held_out_errors
from sim_backend.reality_gap.joints.look import JointProblem, Look
from sim_backend.reality_gap.joints.motor_law import LIMIT
from sim_backend.reality_gap.joints.plant import Plant
from sim_backend.reality_gap.joints.rattling import Rattling, rattling_joints
from sim_backend.reality_gap.joints.state import JointState
from sim_backend.reality_gap.joints.trajectory import trajectory
from sim_backend.reality_gap.knowledge.evidence import FELT, FITTED, TAKES_OVER, Channel, Sign
from sim_backend.reality_gap.knowledge.robot import KnownTriFinger, Robot
from sim_backend.reality_gap.outliers import PEAK, usual_peak_nm
from sim_backend.reality_gap.recording import JointSignals, Recording, RecordingError
from sim_backend.trifinger import constants as c

LEAST_REDUCTION = 0.02
"""Share of the held-out error that a cause must take away where there are no healthy sessions to compare with."""
LEAST_TORQUE_SHARE = 0.01
"""And what it takes away must be this share of the joint's torque: integrators and filters alone make errors of some 0.1 %."""
_FOREIGN_GATE = 12.0
"""Nats that a cause must gain where no healthy sessions are known: odds of 160 000, shared by some hundred hypotheses."""
_LEAST_MOTION_RAD_S = 0.05
_LEAST_MOVING_SHARE = 0.02
_LEAST_S, _PIECE_S = 18.0, 10.0
"""A TriFinger's recordings together: healthy sessions of 20 s and more are known. Pieces of 2 to 10 s gave false names."""


class ShowsNothingError(Exception):
    """The recordings could not show what is wrong with the joints; ``because`` says why in two words."""

    def __init__(self, message: str, because: str) -> None:
        super().__init__(message)
        self.because = because


@dataclass(frozen=True)
class JointStudy:
    """What the joints' recordings say.

    Attributes:
        problem: the episodes as equations.
        fit: causes in the order in which they were taken.
        findings: what needed no fit.
        rattling: joints whose rotor rattles; their mechanics is in no fit.
        odd: what no healthy robot shows either, but whose effect was left out of the catalogue.
        gate: nats that a cause had to gain.
        robot: what is known of it.
        start: the nominal model.
        gates: nats that a cause of each effect had to gain, where healthy sessions tell.
    """

    problem: JointProblem
    fit: JointFit
    findings: tuple[Finding, ...]
    rattling: tuple[Rattling, ...]
    odd: tuple[Finding, ...]
    gate: float
    robot: Robot
    start: JointState
    gates: Mapping[str, float]

    @property
    def is_judged(self) -> np.ndarray:
        """Whether the mechanics of each joint had an equation at all, shape (k,)."""
        judged = np.zeros(len(self.problem.names), bool)
        judged[[equation.joint for equation in self.fit.first.left if equation.channel is Channel.MECHANICS]] = True
        return judged

    @property
    def is_of_many(self) -> bool:
        """Whether so much is wrong with a TriFinger that each cause takes over what the laws of the others leave."""
        return self.problem.expects_many and isinstance(self.robot, KnownTriFinger)

    def problem_start(self, key: str, index: int) -> float:
        """A value of the model that the study started from."""
        return float(self.start.value(key)[index])


def study_joints(
    model: mujoco.MjModel,
    recordings: Sequence[Recording],
    progress: Callable[[str, float], None],
    *,
    robot: Robot,
    excluded: Sequence[str] = (),
    nominal: Mapping[str, np.ndarray] | None = None,
    gate: float | None = None,
) -> JointStudy:
    """Compare recordings with a model and find what is wrong with it.

    Args:
        model: the nominal one.
        recordings: with joints, all the same ones.
        progress: told what is done, and which share of all.
        robot: what is known of it.
        excluded: effects that are left out of the catalogue.
        nominal: values to start from, by parameter, shape (k,), (1,) or (3,); beside what the model itself says of its joints.
        gate: least gain in nats; the calibrated one if None.

    Raises:
        RecordingError: recordings that cannot be used.
        ShowsNothingError: no joint moves, or a TriFinger's are too short.
    """
    names, is_trifinger = _names(recordings), isinstance(robot, KnownTriFinger)
    if is_trifinger:
        _check_length(recordings)
    plant = Plant(model, names)
    episodes = []
    for index, recording in enumerate(recordings):
        progress(f"smoothing {recording.name}", 0.15 * index / len(recordings))
        episodes.append(_equations(plant, recording, index, robot))
    limit = c.MAX_TORQUE_NM if is_trifinger else largest_torque_nm([e.driving_nm for e in episodes])
    start = starting_values(plant, limit, nominal or {})
    size = 1.0 if is_trifinger else max(1.0, float(np.max(limit)) / c.MAX_TORQUE_NM)
    nominal_state = JointState(len(names), start, size)
    rattling = rattling_joints(episodes, nominal_state) if is_trifinger else []
    loose = {each.joint for each in rattling}  # a rotor's hit is no jump of its encoder
    faults = [fault for fault in fault_findings(episodes, size=None if is_trifinger else size) if fault.joint not in loose]
    for index, corrected in _without_jumps(recordings, faults).items():
        reported = recordings[index].joints
        episodes[index] = _equations(plant, corrected, index, robot, reported=reported)
    for fault in faults:
        if fault.sign is not Sign.POSITION_JUMP and fault.joint is not None:
            for episode in episodes:
                episode.ignore_joint(fault.joint)
    _check_motion(episodes)
    left_out = tuple(excluded)
    excluded = (*excluded, *{TAKES_OVER[f.sign] for f in faults if f.sign in TAKES_OVER})
    for each in rattling:
        for episode, apart in zip(episodes, each.apart, strict=True):
            episode.ignore_rattling(each.joint, apart)
    for end in end_findings(episodes, nominal_state) if is_trifinger else ():
        for episode in episodes:
            episode.keep_off(end.joint or 0, 1 if end.sign is Sign.UPPER_END else 0, end.value)
    problem = JointProblem(episodes, names, robot=robot, excluded=excluded)
    used_gate = gate if gate is not None else _FOREIGN_GATE
    gates = robot.healthy.gates if gate is None else {}
    felt = noise_of_motors(problem, nominal_state) if is_trifinger else []
    confirms = functools.partial(may_follow if is_trifinger else is_worth_it, problem)
    fit = select(problem, nominal_state, used_gate, progress, confirms=confirms, gates=gates)
    last = fit.last
    checks = noise_findings(episodes, robot)
    if is_trifinger:  # what presses where, and what motors make of torques, nobody knows of another robot
        checks += end_findings(episodes, fit.state)
        checks += felt or torque_noise_findings(episodes, fit.state, last.sensed_share, last.sensed_error)
    found = [*faults, *(each.finding for each in rattling), *checks]
    return JointStudy(
        problem,
        with_measured_lateness(fit, episodes),
        tuple(f for f in found if f.effect not in excluded),
        tuple(each for each in rattling if each.finding.effect not in excluded),
        tuple(f for f in found if f.effect in left_out),
        used_gate,
        robot,
        nominal_state,
        gates,
    )


def _equations(
    plant: Plant, recording: Recording, index: int, robot: Robot, *, reported: JointSignals | None = None
) -> EpisodeEquations:
    """One episode's; ``reported`` is what the robot's controller saw, where positions were corrected since."""
    path = trajectory(recording, cutoff_hz=robot.cutoff_hz)
    return EpisodeEquations(plant, path, index, robot=robot, reported=reported)


def largest_torque_nm(torques_nm: Sequence[np.ndarray]) -> float:
    """The largest torque of any joint, shapes (k, s), though no more than a motor that often gives what it gives can peak at."""
    largest = 0.0
    for torque in np.concatenate(torques_nm, axis=1):
        peak, often = float(np.abs(torque).max()), PEAK * usual_peak_nm(torque)
        largest = max(largest, min(peak, often) if often > 0.0 else peak)
    return largest


def starting_values(plant: Plant, limit_nm: float, nominal: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of effects that a study starts from: the motors' limit, and nominal values on top of those in the model itself.

    Args:
        plant: of the nominal model, whose dry friction, damping and armature count.
        limit_nm: torque that no motor gave more of.
        nominal: by parameter, shape (k,), (1,) or (3,); NaN for a motor whose limit is not stated.
    """
    own = {key: values + nominal.get(key, 0.0) for key, values in plant.own_values.items() if values.any()}
    limits = nominal.get(LIMIT, np.full(plant.joints, np.nan))
    return {**nominal, **own, LIMIT: np.where(np.isnan(limits), limit_nm, limits)}


def noise_of_motors(problem: JointProblem, state: JointState) -> list[Finding]:
    """Noise of single motors that their joints feel; their mechanics is then left out, since it would explain the noise."""
    odd = noisy_motors(problem.episodes, state)
    if not odd:
        return []
    look = problem.look(state, ())
    if look.noise_ratio.max() > MANY_CAUSES:
        return []
    found = torque_noise_findings(problem.episodes, state, look.sensed_share, look.sensed_error)
    felt = [f for f in found if f.sign in FELT and f.joint in odd]
    for finding in felt:
        for episode in problem.episodes:
            episode.ignore_joint(finding.joint or 0)
    return felt


def _without_jumps(recordings: Sequence[Recording], faults: Sequence[Finding]) -> dict[int, Recording]:
    """Recordings as their encoders would have reported them without losing counts, by index; only those with jumps."""
    corrected: dict[int, Recording] = {}
    for jump in faults:
        if jump.sign is not Sign.POSITION_JUMP:
            continue
        recording = corrected.get(jump.episode, recordings[jump.episode])
        assert recording.joints is not None and jump.joint is not None
        position = recording.joints.position_rad.copy()
        position[jump.sample :, jump.joint] -= jump.value
        corrected[jump.episode] = replace(recording, joints=replace(recording.joints, position_rad=position))
    return corrected


def may_follow(problem: JointProblem, before: Look, after: Look) -> bool:
    """Whether a TriFinger's torque or mass may be to blame beside other causes: only if it is worth it.

    What the law of an earlier cause leaves spreads over the torques and masses of its finger, one after the other.
    """
    is_first = not before.accepted or problem.expects_many
    return is_first or not FITTED[after.accepted[-1].effect].scales_everything or is_worth_it(problem, before, after)


def is_worth_it(problem: JointProblem, before: Look, after: Look) -> bool:
    """Whether held-out errors fall: at one joint at least by enough, and over all joints."""
    old, new = (held_out_errors(problem, look).by_joint_nm for look in (before, after))
    reduction = 1.0 - new / np.maximum(old, 1e-12)
    removed_nm = np.sqrt(np.maximum(old**2 - new**2, 0.0))
    is_enough = (reduction > LEAST_REDUCTION) & (removed_nm > LEAST_TORQUE_SHARE * problem.torque_rms_nm)
    return bool(is_enough.any() and reduction.min() > -0.5 * LEAST_REDUCTION)


def _names(recordings: Sequence[Recording]) -> tuple[str, ...]:
    found = {recording.joints.names for recording in recordings if recording.joints is not None}
    if len(found) != 1:
        raise RecordingError(f"all episodes must have the same joints; found {sorted(found) or 'none'}")
    for recording in recordings:
        joints = recording.joints
        if joints is not None and joints.commanded_torque_nm is None and joints.measured_torque_nm is None:
            raise RecordingError(
                f"{recording.source}: episode {recording.name} has no torque; give commanded or measured torques, "
                "or position targets and the controller that follows them"
            )
    return found.pop()


def _check_motion(episodes: Sequence[EpisodeEquations]) -> None:
    moving = max(float(np.mean(np.abs(e.path.velocity) > _LEAST_MOTION_RAD_S, axis=0).max()) for e in episodes)
    if moving < _LEAST_MOVING_SHARE:
        raise ShowsNothingError(
            f"no joint moves faster than {_LEAST_MOTION_RAD_S:g} rad/s for {_LEAST_MOVING_SHARE:.0%} of the time", "they rest"
        )


def _check_length(recordings: Sequence[Recording]) -> None:
    known_s = [float(_is_known(recording).sum()) * recording.step_s for recording in recordings]
    together_s = sum(each for each in known_s if each > _PIECE_S)
    if together_s < _LEAST_S:
        raise ShowsNothingError(
            f"recordings of more than {_PIECE_S:g} s last {together_s:.1f} s in all, and it takes {_LEAST_S:g} s to tell "
            "an effect from chance",
            "too short",
        )


def _is_known(recording: Recording) -> np.ndarray:
    """Samples in which every joint's position was measured, shape (s,)."""
    assert recording.joints is not None
    return np.isfinite(recording.joints.position_rad.sum(axis=1))
