"""One trial, from lease to outcome: goal, robot, policy, the control loop, the log and the score."""

import contextlib
import functools
import platform
import time
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from api_schemas.jail_report import JailReport
from api_schemas.policy import PolicyManifest, canonical_json
from api_schemas.robot import Lease
from api_schemas.tracker import TrackerName
from api_schemas.trial import FAULT_OF, MAX_REASON, FailureCause, Fault, Glimpse, Measures, Outcome, OutcomeKind, PolicyTiming
from robot_farm.excitation_run import run_excitation
from robot_farm.link.lease_keeper import TrialStoppedError
from robot_farm.policy.jail import JailedPolicy, PolicyFailedError
from robot_farm.prepared import Prepared, prepare_plainly, shape_of_lease
from robot_farm.recorder import Recorder
from robot_farm.run import Failure, Progress, Run
from robot_farm.truth import rounded, write_physics
from sim_backend.driver.driver import Measurement
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.episode import Episode
from sim_backend.evidence import Witness
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c
from sim_backend.trifinger import viewer_scene
from sim_backend.trifinger.form import scene_form
from sim_backend.trifinger.objects import Shape
from sim_backend.trifinger.scene import build_scene
from trial_logs import trial_log
from trial_logs.trial_log import LogChannels, TrialLogWriter

if TYPE_CHECKING:
    from robot_farm.exposures import Exposures
    from robot_farm.eyes import Eyes
    from robot_farm.photographer import Photographer

GLIMPSE_DIGITS = 3
"""Of radians and metres."""
KEPT_MODELS = 8
"""Objects come in any scale, so that what is kept of them must end somewhere."""

__all__ = ["Progress", "TrialStoppedError", "log_channels", "run_trial"]


def log_channels() -> LogChannels:
    """The channels of a TriFinger's logs where all robots are alike; a robot makes them once."""
    return LogChannels(joint_names=c.JOINT_NAMES, frames=viewer_scene.MEASURED_FRAMES)


def measured_channels() -> LogChannels:
    """The channels of a log that holds nothing but what a real robot could give."""
    return LogChannels(joint_names=c.JOINT_NAMES, frames=viewer_scene.MEASURED_FRAMES, topics=trial_log.MEASURED_TOPICS)


def run_trial(
    lease: Lease,
    policy: JailedPolicy | None,
    driver: SimulatedDriver,
    channels: LogChannels,
    log_path: Path,
    *,
    stop_reason: Callable[[], str | None],
    physics: str = "nominal",
    progress: Progress | None = None,
    prepared: Prepared | None = None,
) -> Outcome:
    """Run a leased trial and write its log.

    Args:
        lease: what to run.
        policy: the policy's process; a failure of it becomes the outcome. None for an excitation.
        driver: the robot (n = 1), with the lease's object in its arena.
        channels: the robot's log channels.
        log_path: where the log is written; must not exist.
        stop_reason: asked in every control period; a text ends the trial.
        physics: name of the robot's physics, for the log.
        progress: filled in as the trial goes on.
        prepared: what the trial begins with; as all ideal robots begin if None.

    Returns:
        The outcome; faults of the policy are outcomes, not exceptions.

    Raises:
        TrialStoppedError: ``stop_reason`` gave a reason.
    """
    started_s, began_at = time.monotonic(), datetime.now(UTC).isoformat(timespec="milliseconds")
    ready = prepared or prepare_plainly(lease, TASKS)
    with contextlib.ExitStack() as stack:
        writer = stack.enter_context(TrialLogWriter(log_path, channels))
        truth = None if ready.truth is None else stack.enter_context(TrialLogWriter(ready.truth.path, ready.truth.channels))
        _describe(writer, lease, physics, ready, began_at)
        sees = lease.images or (lease.manifest is not None and lease.manifest.images is not None)
        exposures = stack.enter_context(_exposures(ready, driver.shape)) if sees else None
        run = Run(lease, ready, driver, stop_reason, progress or Progress(), truth, exposures)
        with Recorder(writer, truth, driver.shape, _photographer(lease, exposures)) as recorder:
            failure, step = run_excitation(run, recorder) if policy is None else _control_loop(run, policy, recorder)
        if failure is None or FAULT_OF[failure[0]] is Fault.PLATFORM:
            failure = _closed(ready, step, failure)
        exact = _measured(run, failure)
        measures = exact if truth is None or exact is None else rounded(exact)
        ended = _outcome(run, failure, measures, time.monotonic() - started_s)
        outcome = ended.model_copy(update={"jail": _jail(policy), "failure": _failure(run, recorder.witness, ended)})
        _tell(writer, run, recorder.witness, outcome, step)
        writer.metadata(trial_log.OUTCOME_METADATA, outcome.model_dump(mode="json"))
        if truth is not None:
            truth.metadata(trial_log.TRIAL_METADATA, _trial_record(lease, physics, began_at))
            as_it_was = outcome.model_copy(update={"measures": exact})
            truth.metadata(trial_log.OUTCOME_METADATA, as_it_was.model_dump(mode="json"))
            write_physics(truth, ready.physics, ready.start, run.changed)
    return outcome.model_copy(update={"glimpse": _glimpse(run, recorder.witness, outcome.failure)})


def _tell(writer: TrialLogWriter, run: Run, witness: Witness, outcome: Outcome, step: int) -> None:
    """The moments that can be told from what was measured, and how the trial ended and why."""
    goal = run.ready.goal if run.ready.task is not None and run.ready.task.moves_cube else None
    for moment in witness.moments(goal, run.driver.shape):
        level: trial_log.Level = "warning" if moment.kind == "not" else "info"
        writer.event(round(moment.t_s / c.PHYSICS_STEP_S), moment.text, level=level, name=trial_log.MOMENT_EVENT)
    if outcome.failure is not None:
        writer.event(step, outcome.failure.sentence, level="warning")
    faulted, missed = outcome.fault is not Fault.NONE, outcome.kind is OutcomeKind.FAILED
    writer.event(step, outcome.reason, level="error" if faulted else "warning" if missed else "info")


def _glimpse(run: Run, witness: Witness, failure: FailureCause | None) -> Glimpse | None:
    """What a small picture of the trial is drawn from; the log has it all, so it holds none of it."""
    seen = witness.glimpses(None if failure is None else failure.at_s)
    if seen is None:
        return None
    t_s, position_rad, poses = (np.round(each, GLIMPSE_DIGITS).tolist() for each in seen)
    goal = None if run.progress.goal is None else tuple(round(each, GLIMPSE_DIGITS) for each in run.progress.goal)
    return Glimpse.model_validate({"t_s": t_s, "joint_position_rad": position_rad, "tracked_pose": poses, "goal": goal})


def _exposures(ready: Prepared, shape: Shape) -> "Exposures":
    """Loaded where a job or its policy asked for images and nowhere else."""
    from robot_farm.exposures import Exposures

    return Exposures(ready, shape)


def _photographer(lease: Lease, exposures: "Exposures | None") -> "Photographer | None":
    """Who makes pictures for the log, where the job asked for them."""
    if exposures is None or not lease.images:
        return None
    from robot_farm.photographer import Photographer

    return Photographer(exposures)


def _eyes(manifest: PolicyManifest, exposures: "Exposures | None") -> "Eyes | None":
    """What shows the images to the policy, where it sees."""
    if manifest.images is None or exposures is None:
        return None
    from robot_farm.eyes import Eyes

    return Eyes(exposures, manifest.images.edge_px)


def _failure(run: Run, witness: Witness, ended: Outcome) -> FailureCause | None:
    """Why the goal was missed, told from what was measured; faults tell of themselves."""
    task = run.ready.task
    if ended.kind is not OutcomeKind.FAILED or task is None or ended.measures is None:
        return None
    why = witness.why(task, run.ready.goal, run.driver.shape, ended.measures.final_position_error_m)
    if why is None:
        return None
    return FailureCause(kind=why.kind, sentence=why.sentence[:MAX_REASON], at_s=why.at_s, finger=why.finger)


def _jail(policy: JailedPolicy | None) -> JailReport | None:
    """What the policy ran in; None if there was none, or if it did not come so far."""
    return None if policy is None or policy.jail is None else JailReport.of(policy.jail)


def _control_loop(run: Run, policy: JailedPolicy, recorder: Recorder) -> tuple[Failure | None, int]:
    """Observe, ask, advance until the task's time is over; returns how it failed, or None, and the step it came to."""
    task, manifest, progress = run.ready.task, run.lease.manifest, run.progress
    assert task is not None and manifest is not None, "a trial of a policy has a task and a manifest"
    episode = Episode(run.driver, run.ready.tracker, manifest)
    recorder.begin(task, run.ready.goal, episode.begin(run.ready.start, run.ready.goal))
    progress.duration_s, progress.simulated_s, progress.tracked = task.duration_s, 0.0, None
    progress.goal = _shown_goal(task, run.ready.goal)
    eyes = _eyes(manifest, run.exposures)
    if eyes is not None:
        eyes.begin(run.driver.measure())
    try:
        policy.reset()
        for index in range(task.steps // manifest.period_steps):
            run.go_on(episode.step)
            observation = episode.observe()
            if eyes is not None:
                policy.show(eyes.newest(run.ready.tracker.latest))
            action, inference_time_ns = policy.act(observation[0].astype(np.float32))
            period = episode.advance(action[None])
            if eyes is not None:
                eyes.take(period.segment)
            recorder.record(period, inference_time_ns, run.temperature_rise_k)
            run.inference_ns.append(inference_time_ns)
            wrong = run.after(period.segment, period.tracked, period.after, (index + 1) / manifest.rate_hz)
            if wrong is not None:
                return (OutcomeKind.PLATFORM_ERROR, wrong), episode.step
    except PolicyFailedError as error:
        reason = f"at {episode.step * c.PHYSICS_STEP_S:.3f} s of {task.duration_s:g} s: {error}"
        return (error.kind, reason), episode.step
    except PhysicsDivergedError as error:
        return (OutcomeKind.PLATFORM_ERROR, str(error)), episode.step
    return None, episode.step


def _shown_goal(task: Task, goal: Goal) -> tuple[float, ...]:
    """The goal as those see it who watch the trial."""
    if not task.moves_cube:
        return tuple(goal.fingertip_position_world_m[0].tolist())
    return (*goal.cube_position_world_m[0].tolist(), *goal.cube_quat_wxyz[0].tolist())


def _closed(ready: Prepared, step: int, failure: Failure | None) -> Failure | None:
    """How the trial failed after all: what a robot finds wrong with itself when it is over is never the policy's fault."""
    wrong = ready.close(step, failure is not None)
    if wrong is None:
        return failure
    return OutcomeKind.PLATFORM_ERROR, wrong if failure is None else f"{failure[1]}; {wrong}"


def _measured(run: Run, failure: Failure | None) -> Measures | None:
    """What the trial achieved, as exactly as the simulation knows it; None where nothing was asked or nothing was done."""
    manifest, task = run.lease.manifest, run.ready.task
    if manifest is None or task is None or not run.states:
        return None
    return _measures(manifest, task, run.ready.goal, run.states, over=failure is None)


def _outcome(run: Run, failure: Failure | None, measures: Measures | None, wall_s: float) -> Outcome:
    manifest, task = run.lease.manifest, run.ready.task
    timing = None if manifest is None or measures is None else _timing(manifest, run.inference_ns)
    if failure is not None:
        kind, reason = failure
    elif measures is None or task is None:
        kind, reason = OutcomeKind.RECORDED, f"excitation {run.lease.excitation} recorded for {run.progress.duration_s:g} s"
    else:
        kind = OutcomeKind.SUCCEEDED if measures.success_at_end else OutcomeKind.FAILED
        reason = _sentence(task, measures)
    return Outcome(
        kind=kind,
        fault=FAULT_OF[kind],
        reason=reason[:MAX_REASON],
        measures=measures,
        policy_timing=timing,
        wall_s=wall_s,
        form=scene_form(),
        tracker=TrackerName.POSE if run.ready.detector is None else TrackerName.IMAGES,
    )


def _measures(manifest: PolicyManifest, task: Task, goal: Goal, states: list[Measurement], *, over: bool) -> Measures:
    """Measures on the true states after each control period; an unfinished trial is no success."""
    scores = score(
        task,
        goal,
        np.concatenate([state.cube_position_world_m for state in states]),
        np.concatenate([state.cube_quat_wxyz for state in states]),
        np.concatenate([state.true_joint_position_rad for state in states]),
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


def _describe(writer: TrialLogWriter, lease: Lease, physics: str, ready: Prepared, began_at: str) -> None:
    """Everything that is known before the first step, so that a log explains itself."""
    writer.metadata(trial_log.TRIAL_METADATA, _trial_record(lease, physics, began_at))
    if lease.manifest is not None:
        writer.attach(trial_log.MANIFEST_ATTACHMENT, "application/json", canonical_json(lease.manifest).encode())
    writer.attach(trial_log.MODEL_ATTACHMENT, "application/xml", _model_xml(shape_of_lease(lease)))
    what = lease.task.value if lease.excitation is None else f"excitation {lease.excitation.value}"
    writer.event(0, f"trial {lease.trial_id}, attempt {lease.fence}, on {lease.robot}: {what}, seed {lease.seed}")
    for text in ready.events:
        writer.event(0, text)


def _trial_record(lease: Lease, physics: str, began_at: str) -> dict[str, Any]:
    """``began_at`` is the only wall clock's time in a log: all others count from the trial's start."""
    return {
        "job_id": lease.job_id,
        "trial_id": lease.trial_id,
        "ordinal": lease.ordinal,
        "attempt": lease.fence,
        "robot": lease.robot,
        "task": lease.task.value,
        "excitation": "" if lease.excitation is None else lease.excitation.value,
        "seed": lease.seed,
        "object": lease.object.value,
        "object_scale": lease.object_scale,
        "physics": physics,
        "form": scene_form(),
        "began_at": began_at,
        **({} if lease.own_goal is None else {"own_goal": lease.own_goal.model_dump(mode="json", exclude_defaults=True)}),
        "policy": lease.policy or "",
        "graph_sha256": lease.graph_sha256 or "",
        "versions": _versions(),
    }


@functools.cache
def _versions() -> dict[str, str]:
    """What runs here; looked up once a process, since an installed version is read from a file."""
    return {
        "trifarm": version("trifarm"),
        "mujoco": version("mujoco-core"),
        "onnxruntime": version("onnxruntime"),
        "python": platform.python_version(),
    }


@functools.lru_cache(maxsize=KEPT_MODELS)
def _model_xml(shape: Shape) -> bytes:
    """The robot's nominal model as MJCF; the same for every trial with an object."""
    return build_scene(shape=shape).to_xml().encode()
