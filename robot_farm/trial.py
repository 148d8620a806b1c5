"""One trial, from lease to outcome: goal, robot, policy, the control loop, the log and the score."""

import functools
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np

from api_schemas import trial_log
from api_schemas.policy import PolicyManifest, canonical_json
from api_schemas.robot import Lease
from api_schemas.trial import FAULT_OF, MAX_REASON, Measures, Outcome, OutcomeKind, PolicyTiming
from api_schemas.trial_log import LogChannels, TrialLogWriter
from robot_farm.jail import JailedPolicy, PolicyFailedError
from robot_farm.recorder import Recorder
from sim_backend.driver.driver import Measurement
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.episode import Episode
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Goal, Task, draw_trial
from sim_backend.trifinger import constants as c
from sim_backend.trifinger import viewer_scene
from sim_backend.trifinger.scene import build_scene


@dataclass
class Progress:
    """What others may see of a running trial; written by the trial, read by the bus link."""

    simulated_s: float = 0.0
    duration_s: float = 0.0
    measurement: Measurement | None = None
    tracked: TrackedPose | None = None


@dataclass
class _Course:
    """What a control loop leaves behind: true states after each period, and inference times."""

    states: list[Measurement] = field(default_factory=list)
    inference_ns: list[int] = field(default_factory=list)


class TrialStoppedError(Exception):
    """The trial was stopped from outside: the lease ended or the job was cancelled."""


def log_channels() -> LogChannels:
    """The channels of a TriFinger's logs; a robot makes them once."""
    return LogChannels(joint_names=c.JOINT_NAMES, frames=viewer_scene.MEASURED_FRAMES)


def run_trial(
    lease: Lease,
    policy: JailedPolicy,
    driver: SimulatedDriver,
    channels: LogChannels,
    log_path: Path,
    *,
    stop_reason: Callable[[], str | None],
    physics: str = "nominal",
    progress: Progress | None = None,
) -> Outcome:
    """Run a leased trial and write its log.

    Args:
        lease: what to run.
        policy: the policy's process; a failure of it becomes the outcome.
        driver: the robot (n = 1).
        channels: the robot's log channels.
        log_path: where the log is written; must not exist.
        stop_reason: asked in every control period; a text ends the trial.
        physics: name of the robot's physics, for the log.
        progress: filled in as the trial goes on.

    Returns:
        The outcome; faults of the policy are outcomes, not exceptions.

    Raises:
        TrialStoppedError: ``stop_reason`` gave a reason.
    """
    started_s = time.monotonic()
    task = TASKS[lease.task.value]
    start, goal = draw_trial(task, lease.seed)
    episode = Episode(driver, Tracker(), lease.manifest)
    with TrialLogWriter(log_path, channels) as writer:
        _describe(writer, lease, physics)
        tracked = episode.begin(start, goal)
        course = _Course()
        with Recorder(writer) as recorder:
            recorder.begin(task, goal, tracked)
            failure = _control_loop(lease, task, policy, episode, recorder, course, stop_reason, progress or Progress())
        outcome = _outcome(lease.manifest, task, goal, course, failure, time.monotonic() - started_s)
        writer.event(episode.step, outcome.reason, error=failure is not None)
        writer.metadata(trial_log.OUTCOME_METADATA, outcome.model_dump(mode="json"))
    return outcome


def _control_loop(
    lease: Lease,
    task: Task,
    policy: JailedPolicy,
    episode: Episode,
    recorder: Recorder,
    course: _Course,
    stop_reason: Callable[[], str | None],
    progress: Progress,
) -> tuple[OutcomeKind, str] | None:
    """Observe, ask, advance until the task's time is over; returns how it failed, or None."""
    periods = task.steps // lease.manifest.period_steps
    progress.duration_s, progress.simulated_s, progress.tracked = task.duration_s, 0.0, None
    try:
        policy.reset()
        for index in range(periods):
            reason = stop_reason()
            if reason is not None:
                raise TrialStoppedError(reason)
            observation = episode.observe()
            action, inference_time_ns = policy.act(observation[0].astype(np.float32))
            period = episode.advance(action[None])
            recorder.record(period, inference_time_ns)
            course.inference_ns.append(inference_time_ns)
            course.states.append(period.after)
            progress.simulated_s = (index + 1) / lease.manifest.rate_hz
            progress.measurement, progress.tracked = period.after, period.tracked[-1] if period.tracked else progress.tracked
    except PolicyFailedError as error:
        return error.kind, f"at {episode.step * c.PHYSICS_STEP_S:.3f} s of {task.duration_s:g} s: {error}"
    except PhysicsDivergedError as error:
        return OutcomeKind.PLATFORM_ERROR, str(error)
    return None


def _outcome(
    manifest: PolicyManifest,
    task: Task,
    goal: Goal,
    course: _Course,
    failure: tuple[OutcomeKind, str] | None,
    wall_s: float,
) -> Outcome:
    measures = _measures(manifest, task, goal, course.states, over=failure is None) if course.states else None
    timing = _timing(manifest, course.inference_ns) if course.inference_ns else None
    if failure is not None:
        kind, reason = failure
    else:
        assert measures is not None, "a trial that ran to its end has at least one period"
        kind = OutcomeKind.SUCCEEDED if measures.success_at_end else OutcomeKind.FAILED
        reason = _sentence(task, measures)
    return Outcome(
        kind=kind, fault=FAULT_OF[kind], reason=reason[:MAX_REASON], measures=measures, policy_timing=timing, wall_s=wall_s
    )


def _measures(manifest: PolicyManifest, task: Task, goal: Goal, states: list[Measurement], *, over: bool) -> Measures:
    """Measures on the true states after each control period; an unfinished trial is no success."""
    scores = score(
        task,
        goal,
        np.concatenate([state.cube_position_world_m for state in states]),
        np.concatenate([state.cube_quat_wxyz for state in states]),
        np.concatenate([state.joint_position_rad for state in states]),
    )
    return Measures(
        success_at_end=bool(scores.success[-1]) and over,
        success_ever=bool(scores.success.any()),
        success_fraction=float(scores.success.mean()),
        final_position_error_m=float(scores.position_error_m[-1]),
        final_angle_error_rad=float(scores.angle_error_rad[-1]) if task.orientation_counts else None,
        episode_return=float(scores.reward.sum()),
        control_steps=len(states),
        simulated_s=len(states) / manifest.rate_hz,
    )


def _timing(manifest: PolicyManifest, inference_ns: list[int]) -> PolicyTiming:
    """Would the policy have been in time on hardware? It has the action delay plus the step of 1 ms that it may use up."""
    inference_ms = np.array(inference_ns) / 1e6
    allowed_ms = manifest.delay_steps + 1.0
    return PolicyTiming(
        mean_ms=float(inference_ms.mean()),
        p99_ms=float(np.quantile(inference_ms, 0.99)),
        max_ms=float(inference_ms.max()),
        allowed_ms=allowed_ms,
        missed=int((inference_ms > allowed_ms).sum()),
    )


def _sentence(task: Task, measures: Measures) -> str:
    verdict = "reached" if measures.success_at_end else "missed"
    angle = measures.final_angle_error_rad
    turned = "" if angle is None else f" and {np.rad2deg(angle):.0f} degrees"
    return f"goal {verdict}: {measures.final_position_error_m * 1000:.0f} mm{turned} away at the end of {task.duration_s:g} s"


def _describe(writer: TrialLogWriter, lease: Lease, physics: str) -> None:
    """Everything that is known before the first step, so that a log explains itself."""
    writer.metadata(
        trial_log.TRIAL_METADATA,
        {
            "job_id": lease.job_id,
            "trial_id": lease.trial_id,
            "ordinal": lease.ordinal,
            "attempt": lease.fence,
            "robot": lease.robot,
            "task": lease.task.value,
            "seed": lease.seed,
            "physics": physics,
            "policy": lease.policy,
            "graph_sha256": lease.graph_sha256,
            "versions": {
                "trifarm": version("trifarm"),
                "mujoco": version("mujoco-core"),
                "onnxruntime": version("onnxruntime"),
                "python": platform.python_version(),
            },
        },
    )
    writer.attach(trial_log.MANIFEST_ATTACHMENT, "application/json", canonical_json(lease.manifest).encode())
    writer.attach(trial_log.MODEL_ATTACHMENT, "application/xml", _model_xml())
    writer.event(0, f"trial {lease.trial_id}, attempt {lease.fence}, on {lease.robot}: {lease.task.value}, seed {lease.seed}")


@functools.cache
def _model_xml() -> bytes:
    """The robot's nominal model as MJCF; the same for every trial of a process."""
    return build_scene().to_xml().encode()
