"""Simulates a trial of a robot with physics of its own again, from what was asked of it and the truth about it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from api_schemas.goal import OwnGoal
from api_schemas.policy import PolicyManifest
from sim_backend.driver.driver import Command, Segment, Start
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.effects.physics import Physics
from sim_backend.episode import Episode
from sim_backend.replays.comparison import (
    Comparison,
    NotRepeatableError,
    Verification,
    check_complete,
    shape_of_log,
    verification,
)
from sim_backend.replays.with_original import compare_with_original
from sim_backend.tasks import TASKS
from sim_backend.tasks.own import with_own
from sim_backend.tasks.task import Goal, draw_trial
from trial_logs.reader import LogUnreadableError, TrialLog, TruthLog

BREAKS = (PhysicsDivergedError, LogUnreadableError, AssertionError, KeyError, IndexError, TypeError, ValueError)
"""What a simulation from unfit files, or one that goes astray, ends with."""
Act = Callable[[np.ndarray], np.ndarray]
"""A policy in the loop: the observation (size,) as float32 to the action (9,)."""


@dataclass
class _Simulated:
    """What the new simulation gave: segments, reports of the tracker and observations, in their order."""

    segments: list[Segment] = field(default_factory=list)
    reports: list[TrackedPose] = field(default_factory=list)
    observations: list[np.ndarray] = field(default_factory=list)
    actions: list[np.ndarray] = field(default_factory=list)

    def joined(self, name: str) -> np.ndarray:
        """A field of all segments, shape (steps, ...)."""
        return np.concatenate([getattr(segment, name)[0] for segment in self.segments])


def verify_with_truth(log: TrialLog, truth: TruthLog, original: TrialLog | None = None, act: Act | None = None) -> Verification:
    """Compare a log, and the truth about its trial, with a new simulation.

    Args:
        log: what is to be verified.
        truth: of its trial.
        original: the farm's own log of the trial. Whatever drives the simulation comes from it, so that a made-up log
            cannot ask the hidden robot a question; None takes the log itself.
        act: the policy, in the loop again; its actions are then compared with the logged ones, which drive otherwise.

    Raises:
        LogUnreadableError: log and truth are not of one trial, or the log's numbers cannot be compared.
        NotRepeatableError: the simulation itself cannot be done.
    """
    check_complete(log)
    attempts = [(m.get("trial_id"), m.get("attempt")) for m in (log.metadata, truth.metadata)]
    if attempts[0] != attempts[1]:
        raise LogUnreadableError(f"the log is of trial {attempts[0][0]}, the truth of trial {attempts[1][0]}")
    found, driving = Comparison(), log if original is None else original
    try:
        check_complete(driving)
        simulated = _simulate(driving, truth, act)
        _compare_truth(found, truth, simulated)
    except BREAKS as error:
        raise NotRepeatableError(f"{type(error).__name__}: {error}") from error
    try:
        _compare_measured(found, log, driving, simulated)
        if original is not None:
            compare_with_original(found, log, original)
    except (IndexError, TypeError, ValueError) as error:
        raise LogUnreadableError(f"the log's numbers cannot be compared: {type(error).__name__}") from error
    return verification(log, driving, found)


def _simulate(log: TrialLog, truth: TruthLog, act: Act | None) -> _Simulated:
    shape, start = shape_of_log(log), start_of(truth)
    physics = Physics.from_document(truth.physics["effects"])
    driver = SimulatedDriver(physics=physics, shape=shape)
    tracker = Tracker(physics=physics, shape=shape)
    changes = changes_of(truth)
    if log.manifest is None:
        return _excited(log, driver, tracker, start, changes)
    return _controlled(log, driver, tracker, start, changes, act)


def goal_of(log: TrialLog) -> Goal:
    """The goal (n = 1) that the trial's seed draws, or its user brought."""
    own = log.metadata.get("own_goal")
    drawn = draw_trial(TASKS[log.metadata["task"]], int(log.metadata["seed"]))
    return with_own(*drawn, None if own is None else OwnGoal.model_validate_json(own))[1]


def changes_of(truth: TruthLog) -> list[tuple[int, Physics]]:
    """What the robot became within the trial, and before which step."""
    return [(int(change["step"]), Physics.from_document(change["effects"])) for change in truth.physics["changes"]]


def _controlled(
    log: TrialLog, driver: SimulatedDriver, tracker: Tracker, start: Start, changes: list, act: Act | None
) -> _Simulated:
    """The logged actions of a policy, or the policy itself, one control period after the other."""
    assert log.manifest is not None, "a trial of a policy has a manifest"
    episode = Episode(driver, tracker, PolicyManifest.model_validate_json(log.manifest))
    simulated = _Simulated(reports=[episode.begin(start, goal_of(log))])
    for logged in log.action:
        change_physics(changes, episode.step, driver, tracker)
        simulated.observations.append(episode.observe()[0].astype(np.float32))
        action = logged if act is None else act(simulated.observations[-1])
        simulated.actions.append(action)
        period = episode.advance(action[None])
        simulated.segments.append(period.segment)
        simulated.reports += period.tracked
    return simulated


def _excited(log: TrialLog, driver: SimulatedDriver, tracker: Tracker, start: Start, changes: list) -> _Simulated:
    """The logged commands of an excitation, each until the next."""
    driver.reset(start)
    simulated, step = _Simulated(reports=[tracker.reset(driver.measure(), start.noise_seed)]), 0
    for command, steps in _commands(log):
        change_physics(changes, step, driver, tracker)
        segment = driver.advance([(command, steps)])
        step += steps
        tracker.capture(segment)
        simulated.segments.append(segment)
        simulated.reports += tracker.deliver(step)
    return simulated


def _commands(log: TrialLog) -> Iterator[tuple[Command, int]]:
    ends = [*log.command_steps[1:], len(log.joint_steps)]
    for row, (begin, end) in enumerate(zip(log.command_steps, ends, strict=True)):
        target = log.command_target_rad[row : row + 1]
        command = Command(log.command_torque_nm[row : row + 1], None if np.isnan(target).all() else target)
        yield command, int(end - begin)


def change_physics(changes: list[tuple[int, Physics]], step: int, driver: SimulatedDriver, tracker: Tracker) -> None:
    """The faults that came before this step; they are taken off the list."""
    while changes and changes[0][0] <= step:
        _, physics = changes.pop(0)
        driver.set_physics(physics)
        tracker.set_physics(physics)


def start_of(truth: TruthLog) -> Start:
    """Where the trial began (n = 1), with the seed of its noise and the temperatures of the motors."""
    physics = truth.physics
    seed, rise_k = physics["noise_seed"], physics["motor_temperature_rise_k"]
    return Start(
        np.array([physics["joint_position_rad"]]),
        np.array([physics["cube_position_world_m"]]),
        np.array([physics["cube_quat_wxyz"]]),
        None if seed is None else np.array([seed]),
        None if rise_k is None else np.array([rise_k]),
    )


def _compare_measured(found: Comparison, log: TrialLog, driving: TrialLog, simulated: _Simulated) -> None:
    steps, reports = driving.joint_steps, simulated.reports
    found.compare(steps, log.joint_position_rad, simulated.joined("joint_position_rad"), "joint")
    for name in ("joint_velocity_rad_s", "measured_torque_nm", "desired_torque_nm", "applied_torque_nm"):
        found.compare(steps, getattr(log, name), simulated.joined(name))
    if driving.manifest is not None:
        found.compare(driving.policy_steps, log.observation, np.array(simulated.observations))
        found.compare(driving.policy_steps, log.action, np.array(simulated.actions))
    delivery_step = np.concatenate([report.delivery_step for report in reports])
    at = np.maximum(delivery_step, 0)
    found.compare(at, log.tracked_position_world_m, np.concatenate([r.cube_position_world_m for r in reports]), "cube")
    found.compare(at, log.tracked_quat_wxyz, np.concatenate([r.cube_quat_wxyz for r in reports]))
    found.compare(at, log.confidence, np.concatenate([r.confidence for r in reports]))
    found.compare(at, log.capture_s, np.concatenate([r.capture_step for r in reports]) * 1_000_000 / 1e9)
    found.compare(at, log.delivery_s, delivery_step * 1_000_000 / 1e9)


def _compare_truth(found: Comparison, truth: TruthLog, simulated: _Simulated) -> None:
    steps = len(simulated.joined("cube_quat_wxyz"))
    for at, logged, name, sort in (
        (truth.joint_steps, truth.joint_position_rad, "true_joint_position_rad", "joint"),
        (truth.joint_steps, truth.joint_velocity_rad_s, "true_joint_velocity_rad_s", ""),
        (truth.joint_steps, truth.effective_torque_nm, "effective_torque_nm", ""),
        (truth.cube_steps, truth.cube_position_world_m, "cube_position_world_m", "cube"),
        (truth.cube_steps, truth.cube_quat_wxyz, "cube_quat_wxyz", ""),
    ):
        found.compare(at, logged, simulated.joined(name)[at[at < steps]], sort)
