"""Joints: from recordings to what was found of them, with a fit and without."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import FITTED, Channel, scales_everything
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.recording import Recording, RecordingError
from sim_backend.reality_gap.subjects.joints.gain import held_out_errors
from sim_backend.reality_gap.subjects.joints.laws.heating import with_measured_heat
from sim_backend.reality_gap.subjects.joints.laws.nominal import nominal_state
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.signs.checks import (
    Finding,
    beside_jumps,
    end_findings,
    noise_findings,
    torque_noise_findings,
)
from sim_backend.reality_gap.subjects.joints.signs.cogging_cycles import with_cycles
from sim_backend.reality_gap.subjects.joints.signs.command_lateness import with_measured_lateness
from sim_backend.reality_gap.subjects.joints.signs.rattling import Rattling
from sim_backend.reality_gap.subjects.joints.signs.unfitted import noise_of_motors, told_without_fit
from sim_backend.reality_gap.subjects.joints.torques.contradictions import contradicts, runs_into_bounds
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations, along
from sim_backend.reality_gap.subjects.joints.torques.fit import JointFit, select
from sim_backend.reality_gap.subjects.joints.torques.look import JointProblem, Look

LEAST_REDUCTION = 0.02
"""Share of the held-out error that a cause must take away where there are no healthy sessions to compare with."""
LEAST_TORQUE_SHARE = 0.01
"""And what it takes away must be this share of the joint's torque: integrators and filters alone make errors of some 0.1 %."""
_USUAL_GATE = 12.0
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
        gates: nats that a cause of each effect had to gain, where healthy sessions tell.
    """

    problem: JointProblem
    fit: JointFit
    findings: tuple[Finding, ...]
    rattling: tuple[Rattling, ...]
    odd: tuple[Finding, ...]
    gate: float
    gates: Mapping[str, float]

    @property
    def robot(self) -> Robot:
        """What is known of it."""
        return self.problem.robot

    @property
    def start(self) -> JointState:
        """The nominal model."""
        return self.problem.start

    @property
    def is_judged(self) -> np.ndarray:
        """Whether the mechanics of each joint had an equation at all, shape (k,)."""
        judged = np.zeros(len(self.problem.names), bool)
        judged[[equation.joint for equation in self.fit.first.left if equation.channel is Channel.MECHANICS]] = True
        return judged

    @property
    def is_of_many(self) -> bool:
        """Whether so much is wrong with a TriFinger that each cause takes over what the laws of the others leave."""
        return self.problem.is_of_many

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
    names = joints_of(recordings)
    if isinstance(robot, KnownTriFinger):
        _check_length(recordings)
    plant = Plant(model, names)
    episodes = along(plant, recordings, robot, progress)
    start = nominal_state(plant, [episode.driving_nm for episode in episodes], robot, nominal or {})
    start = with_measured_heat(start, *zip(*((e.driving_nm, e.warmth_k, e.path.step_s) for e in episodes), strict=True))
    unfitted = told_without_fit(plant, recordings, episodes, robot, start)
    _check_motion(unfitted.episodes)
    if isinstance(robot, UnknownRobot):
        start = with_cycles(start, unfitted.episodes)
    asked_without = (*excluded, *unfitted.taken_over)
    problem = JointProblem(tuple(unfitted.episodes), names, robot, asked_without, start)
    felt = noise_of_motors(problem, start)
    used_gate, gates = (_USUAL_GATE, robot.healthy.gates) if gate is None else (gate, {})
    fit = select(problem, used_gate, progress, confirms=is_worth_it_beside, gates=gates)
    found = beside_jumps([*unfitted.findings, *checked(problem, fit, felt)])
    return JointStudy(
        fit.problem,
        with_measured_lateness(problem, fit),
        tuple(f for f in found if f.effect not in asked_without),
        tuple(each for each in unfitted.rattling if each.finding.effect not in asked_without),
        tuple(f for f in found if f.effect in excluded),
        used_gate,
        gates,
    )


def is_worth_it_beside(problem: JointProblem, before: Look, after: Look) -> bool:
    """Whether a cause may follow others, or is possible at all. Of a TriFinger only torques and masses must be worth it.

    What the law of an earlier cause leaves spreads over the torques and masses of its finger, one after the other.
    """
    if isinstance(problem.robot, KnownTriFinger):
        is_first = not before.accepted or problem.expects_many
        if is_first or not scales_everything(after.accepted[-1].effect):
            return True
    elif contradicts(problem, after.state) or runs_into_bounds(after.state, problem.start, after.accepted):
        return False
    return is_worth_it(problem, before, after)


def checked(problem: JointProblem, fit: JointFit, felt: Sequence[Finding]) -> list[Finding]:
    """What sensors, ends and motors show beside the fit; ``felt`` is the noise of motors that was found before it."""
    checks = noise_findings(problem.episodes, problem.robot)
    if isinstance(problem.robot, KnownTriFinger):  # what presses where, and what motors make of torques, nobody knows of another
        checks += end_findings(problem.episodes, fit.state)
        checks += felt or torque_noise_findings(problem.episodes, fit.state, fit.last.sensed_share, fit.last.sensed_error)
    return checks


def is_worth_it(problem: JointProblem, before: Look, after: Look) -> bool:
    """Whether errors fall in the cause's equations: at one joint at least by enough, and over all joints."""
    usual, channel = problem.torque_rms_nm, shown_in(after.accepted[-1].effect, before)
    if isinstance(problem.robot, KnownTriFinger) or channel is Channel.MECHANICS:
        old, new = (held_out_errors(problem, look).by_joint_nm for look in (before, after))
    else:
        old, new = (look.left_of(channel, len(problem.names)) for look in (before, after))
        usual = problem.speed_rms_rad_s if channel is Channel.VELOCITY else usual
    reduction = 1.0 - new / np.maximum(old, 1e-12)
    removed = np.sqrt(np.maximum(old**2 - new**2, 0.0))
    is_enough = (reduction > LEAST_REDUCTION) & (removed > LEAST_TORQUE_SHARE * usual)
    is_worse = reduction <= -0.5 * LEAST_REDUCTION
    if isinstance(problem.robot, UnknownRobot):  # whose tolerances move a little with every cause
        is_worse &= np.sqrt(np.maximum(new**2 - old**2, 0.0)) > LEAST_TORQUE_SHARE * usual
    return bool(is_enough.any() and not is_worse.any())


def shown_in(effect: str, look: Look) -> Channel:
    """The equation in which a study sees an effect: what changes the current shows in the mechanics where nobody measured it."""
    channel = FITTED[effect].channel
    return channel if any(equation.channel is channel for equation in look.left) else Channel.MECHANICS


def _check_motion(episodes: Sequence[EpisodeEquations]) -> None:
    moving = max(float(np.mean(np.abs(e.path.velocity) > _LEAST_MOTION_RAD_S, axis=0).max()) for e in episodes)
    if moving < _LEAST_MOVING_SHARE:
        raise ShowsNothingError(
            f"no joint moves faster than {_LEAST_MOTION_RAD_S:g} rad/s for {_LEAST_MOVING_SHARE:.0%} of the time, with rows "
            f"{max(e.path.step_s for e in episodes):.3g} s apart (is the unit of time right?)",
            "they rest",
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


def joints_of(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Of the joints that all recordings have.

    Raises:
        RecordingError: they have not the same ones, or one has no torque.
    """
    found = {recording.joints.names for recording in recordings if recording.joints is not None}
    if len(found) != 1:
        raise RecordingError(f"all episodes must have the same joints; found {sorted(found) or 'none'}")
    for recording in recordings:
        joints = recording.joints
        if joints is not None and joints.commanded_torque_nm is None and joints.measured_torque_nm is None:
            raise RecordingError(
                f"{recording.source}: episode {recording.name} has no torque; give commanded or measured torques, "
                "position targets and the controller that follows them, or passive = true of joints that nothing drives"
            )
    return found.pop()
