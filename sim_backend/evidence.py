"""What explains a failed trial, gathered from measured numbers alone: while it runs, or from its log; both give the same."""

import json
from dataclasses import dataclass, field

import numpy as np

from api_schemas.tolerance import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M
from sim_backend.driver.tracker import CONFIDENCE_THRESHOLD, TrackedPose
from sim_backend.replays.comparison import shape_of_log
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.objects import Kind, Shape
from trial_logs.failing import Why, why_failed
from trial_logs.measured import Evidence
from trial_logs.moments import Moment, Seen, holds_of_fingers, way_of_object
from trial_logs.reader import TrialLog

EVERY_STEPS = 10
GLIMPSES = 10
"""Poses of a trial that its small picture shows."""
FINGERS = tuple(f"finger {name.removeprefix('finger')}" for name in c.FINGER_NAMES)


@dataclass
class Witness:
    """Keeps of a running trial (n = 1) what explains its end: every tenth millisecond, and all reports of the tracker."""

    _states: list[tuple[np.ndarray, ...]] = field(default_factory=list)
    _reports: list[tuple[float, np.ndarray, float]] = field(default_factory=list)

    def take(self, first_step: int, position_rad: np.ndarray, velocity_rad_s: np.ndarray, applied_nm: np.ndarray) -> None:
        """Steps from ``first_step`` on, each of shape (steps, 9)."""
        rows = np.arange(-first_step % EVERY_STEPS, len(position_rad), EVERY_STEPS)
        times = (first_step + rows) * c.PHYSICS_STEP_S
        self._states.append((times, position_rad[rows], velocity_rad_s[rows], applied_nm[rows]))

    def take_report(self, tracked: TrackedPose) -> None:
        """A report as it came."""
        pose = np.concatenate([tracked.cube_position_world_m[0], tracked.cube_quat_wxyz[0]])
        self._reports.append((int(tracked.capture_step[0]) * c.PHYSICS_STEP_S, pose, float(tracked.confidence[0])))

    def glimpses(self, decided_s: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """A few moments, evenly over the trial and the deciding one: times, joint positions (n, 9), tracked poses (n, 7).

        None where there is too little to show.
        """
        if not self._states or not self._reports:
            return None
        t_s, position_rad = (np.concatenate([each[at] for each in self._states]) for at in (0, 1))
        wanted_s = np.linspace(t_s[0], t_s[-1], GLIMPSES)
        if decided_s is not None:
            wanted_s[np.argmin(np.abs(wanted_s - decided_s))] = np.clip(decided_s, t_s[0], t_s[-1])
        capture_s, poses = (np.array([report[at] for report in self._reports]) for at in (0, 1))
        rows = np.clip(np.searchsorted(t_s, wanted_s), 0, len(t_s) - 1)
        reports = np.clip(np.searchsorted(capture_s, wanted_s, side="right") - 1, 0, len(capture_s) - 1)
        return t_s[rows], position_rad[rows], poses[reports]

    def moments(self, goal: Goal | None, shape: Shape) -> list[Moment]:
        """What happened and when, by time, as far as joints and reports tell; ``goal`` is one of the object's."""
        if not self._states or not self._reports:
            return []
        t_s, position_rad = (np.concatenate([each[at] for each in self._states]) for at in (0, 1))
        capture_s, poses, confidence = (np.array(each) for each in zip(*self._reports, strict=True))
        seen = _seen(capture_s, poses, confidence, t_s, position_rad, shape)
        goal_m = None if goal is None else goal.cube_position_world_m[0]
        found = [*way_of_object(seen.t_s, seen.pose, goal_m, POSITION_TOLERANCE_M), *holds_of_fingers(seen)]
        return sorted(found, key=lambda moment: moment.t_s)

    def why(self, task: Task, goal: Goal, shape: Shape, judged_error_m: float | None) -> Why | None:
        """Why the trial failed; None where there is too little to tell from."""
        if not self._states or not self._reports:
            return None
        states = tuple(np.concatenate(each) for each in zip(*self._states, strict=True))
        capture_s, poses, confidence = (np.array(each) for each in zip(*self._reports, strict=True))
        return _why(task, goal, shape, states, (capture_s, poses, confidence), judged_error_m)


def why_of_log(log: TrialLog) -> Why | None:
    """Why the trial of a log failed; None if it did not, or has no goal."""
    task = TASKS.get(log.metadata.get("task", ""))
    measures = json.loads(log.outcome.get("measures", "null"))
    if task is None or measures is None or measures["success_at_end"]:
        return None
    rows = np.flatnonzero(log.joint_steps % EVERY_STEPS == 0)
    states = (log.joint_position_rad[rows], log.joint_velocity_rad_s[rows], log.applied_torque_nm[rows])
    reports = (log.capture_s, np.concatenate([log.tracked_position_world_m, log.tracked_quat_wxyz], axis=1), log.confidence)
    goal, shape = _goal_of(log), shape_of_log(log)
    times = log.joint_steps[rows] * c.PHYSICS_STEP_S
    return None if goal is None else _why(task, goal, shape, (times, *states), reports, measures["final_position_error_m"])


def _goal_of(log: TrialLog) -> Goal | None:
    if log.goal is None:
        return None
    position_m, quat_wxyz = log.goal
    return Goal(np.atleast_2d(position_m), np.atleast_2d(quat_wxyz), np.zeros((1, 9)))


def _why(
    task: Task,
    goal: Goal,
    shape: Shape,
    states: tuple[np.ndarray, ...],
    reports: tuple[np.ndarray, np.ndarray, np.ndarray],
    judged_error_m: float | None,
) -> Why:
    state_t_s, position_rad, velocity_rad_s, applied_nm = states
    return why_failed(
        Evidence(
            seen=_seen(*reports, state_t_s, position_rad, shape),
            duration_s=float(state_t_s[-1]) + EVERY_STEPS * c.PHYSICS_STEP_S,
            goal_m=goal.cube_position_world_m[0] if task.moves_cube else None,
            goal_quat_wxyz=goal.cube_quat_wxyz[0] if task.orientation_counts else None,
            tips_away_m=None if task.moves_cube else _tips_away_m(position_rad, goal),
            velocity_rad_s=velocity_rad_s,
            applied_nm=applied_nm,
            joints=c.JOINT_NAMES,
            max_torque_nm=c.MAX_TORQUE_NM,
            wall_m=c.ARENA_RADIUS_M,
            within_m=POSITION_TOLERANCE_M,
            within_rad=ANGLE_TOLERANCE_RAD,
            judged_error_m=judged_error_m,
        )
    )


def _tips_away_m(position_rad: np.ndarray, goal: Goal) -> np.ndarray:
    """Distances of the fingertips from their goals, shape (n, fingers), for joints of shape (n, 9)."""
    apart_m = fingertip_position_world_m(position_rad) - goal.fingertip_position_world_m
    return np.linalg.norm(apart_m.reshape(-1, 3, 3), axis=2)


def _seen(
    capture_s: np.ndarray,
    poses: np.ndarray,
    confidence: np.ndarray,
    state_t_s: np.ndarray,
    position_rad: np.ndarray,
    shape: Shape,
) -> Seen:
    """The object by the time at which it was seen, where the tracker was sure, and where the fingertips were then."""
    order = np.argsort(capture_s, kind="stable")
    order = order[confidence[order] >= CONFIDENCE_THRESHOLD]  # below it the pose before is repeated
    at_s = np.maximum(capture_s[order], 0.0)
    nearest = np.clip(np.searchsorted(state_t_s, at_s), 0, len(state_t_s) - 1)
    half_m, tips_m = np.array(shape.size_m) / 2, fingertip_position_world_m(position_rad[nearest]).reshape(-1, 3, 3)
    return Seen(at_s, poses[order], tips_m, half_m, shape.kind is Kind.SPHERE, c.TIP_RADIUS_M, FINGERS)
