"""Recordings from the farm's own logs: ``/measured/`` channels alone, whatever else a file may hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.recording import JointSignals, ObjectSignals, Recording, RecordingError
from sim_backend.trifinger import constants as c
from trial_logs.reader import LogUnreadableError, TrialLog, read_log, read_trial

_MIN_STEPS = 1000


@dataclass(frozen=True)
class FarmLogs:
    """The logs of a folder: ``judged`` are studied, ``trials`` are not; ``robot`` made the judged ones, if they say which."""

    judged: tuple[Path, ...]
    trials: tuple[Path, ...]
    robot: str | None


def find_logs(folder: Path) -> FarmLogs:
    """What there is to study in a folder, truth files left out; no rows are read.

    Raises:
        RecordingError: there is none, one cannot be read, or they are of several robots.
    """
    files = sorted(path for path in folder.glob("*.mcap") if "truth" not in path.name)
    if not files:
        raise RecordingError(f"{folder} has no logs (*.mcap): 'trifarm identify --robot ROBOT --to {folder}' makes some")
    try:
        headers = {path: read_trial(path) for path in files}
    except LogUnreadableError as error:
        raise RecordingError(f"{error}; fetch it again") from error
    trials = tuple(path for path, header in headers.items() if header.get("task") and not header.get("excitation"))
    judged = tuple(path for path in files if path not in trials)
    if not judged:
        many = f"the {len(trials)} logs are of trials" if len(trials) > 1 else f"{files[0].name} is the log of a trial"
        raise RecordingError(
            f"{many}, in which fingers may touch the cube and the table; joints are judged in the air alone: record excitations "
            "with 'trifarm identify --robot ROBOT --to DIR' and study DIR, with these trials as --trials"
        )
    robots = {headers[path].get("robot", "") for path in judged}
    if len(robots) > 1:
        raise RecordingError(
            f"the logs are of {len(robots)} robots ({', '.join(sorted(robots))}): "
            f"a study is of one robot; give it a folder of its own"
        )
    return FarmLogs(judged, trials, robots.pop() or None)


def read_farm_logs(files: Sequence[Path], progress: Callable[[str, float], None]) -> list[Recording]:
    """One recording for each log.

    Raises:
        RecordingError: a file that cannot be read or is too short, by name.
    """
    found = []
    for index, path in enumerate(files):
        progress(f"reading {path.name}", index / len(files))
        try:
            log = read_log(path)
        except LogUnreadableError as error:
            raise RecordingError(f"{error}; fetch it again") from error
        found.append(_recording(log, path))
    return found


def _recording(log: TrialLog, path: Path) -> Recording:
    steps = len(log.joint_steps)
    if steps < _MIN_STEPS:
        raise RecordingError(f"{path.name} holds {steps} joint states; a study needs at least {_MIN_STEPS} (1 s)")
    desired, target = _commands(log)
    joints = JointSignals(
        names=c.JOINT_NAMES,
        position_rad=_on_grid(log.joint_steps, log.joint_position_rad),
        velocity_rad_s=_on_grid(log.joint_steps, log.joint_velocity_rad_s),
        commanded_torque_nm=_on_grid(log.joint_steps, log.applied_torque_nm),
        measured_torque_nm=_on_grid(log.joint_steps, log.measured_torque_nm),
        desired_torque_nm=desired,
        position_target_rad=target,
    )
    seen = _seen(log)
    time_s = c.PHYSICS_STEP_S * np.arange(len(joints.position_rad))
    regime = log.metadata.get("excitation") or log.metadata.get("task") or ""
    return Recording(path.stem, path.name, c.PHYSICS_STEP_S, time_s, joints, (seen,) if seen else (), regime=regime)


def _on_grid(steps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at their steps, NaN at steps that are missing."""
    first, last = int(steps[0]), int(steps[-1])
    grid = np.full((last - first + 1, values.shape[1]), np.nan)
    grid[steps - first] = values
    return grid


def _commands(log: TrialLog) -> tuple[np.ndarray | None, np.ndarray | None]:
    """What was asked for at each step: of an excitation, torque and position target; of a policy, a torque."""
    first = int(log.joint_steps[0])
    count = int(log.joint_steps[-1]) - first + 1
    if len(log.command_steps):
        held = np.searchsorted(log.command_steps, first + np.arange(count), side="right") - 1
        held = np.maximum(held, 0)
        return log.command_torque_nm[held], log.command_target_rad[held]
    desired = _on_grid(log.joint_steps, log.desired_torque_nm)
    return desired, np.full_like(desired, np.nan)


def _seen(log: TrialLog) -> ObjectSignals | None:
    if not len(log.capture_s):
        return None
    return ObjectSignals(
        name="cube",
        body="cube",
        time_s=log.capture_s,
        position_m=log.tracked_position_world_m,
        quat_wxyz=log.tracked_quat_wxyz,
        delivery_s=log.delivery_s,
        confidence=log.confidence,
    )
