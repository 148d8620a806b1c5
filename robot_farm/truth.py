"""The truth about one trial, in a file that only operators can fetch: states, physics, seeds, faults."""

from dataclasses import dataclass
from pathlib import Path

from api_schemas.trial import Measures
from robot_farm.faults import Change
from sim_backend.driver.driver import Start
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from trial_logs import trial_log
from trial_logs.trial_log import LogChannels, TrialLogWriter


@dataclass(frozen=True)
class TruthFile:
    """Where the truth about a trial is written, and with which channels."""

    path: Path
    channels: LogChannels


def truth_channels() -> LogChannels:
    """The channels of a robot's truth files; a robot makes them once."""
    return LogChannels(joint_names=c.JOINT_NAMES, frames=(), topics=trial_log.TRUTH_TOPICS)


def rounded(measures: Measures) -> Measures:
    """Measures as everybody may see them: to 1 mm, 0.01 rad and a tenth of the return.

    They are measured on true poses; at full precision they would give away by how much the cameras and encoders are off.
    """
    angle_rad = measures.final_angle_error_rad
    return measures.model_copy(
        update={
            "final_position_error_m": round(measures.final_position_error_m, 3),
            "final_angle_error_rad": None if angle_rad is None else round(angle_rad, 2),
            "episode_return": round(measures.episode_return, 1),
        }
    )


def write_physics(truth: TrialLogWriter, physics: Physics, start: Start, changed: list[tuple[int, Change]]) -> None:
    """Everything that a simulation of the same trial needs.

    Args:
        truth: writer of the truth file.
        physics: the robot's (n = 1) when the trial began.
        start: where it began, with the seed of the noise and the temperatures of the motors.
        changed: how the physics changed, and before which step.
    """
    seed, rise_k = start.noise_seed, start.motor_temperature_rise_k
    record = {
        "effects": physics.document(),
        "changes": [{"step": step, "effects": change.physics.document()} for step, change in changed],
        "joint_position_rad": start.joint_position_rad[0].tolist(),
        "cube_position_world_m": start.cube_position_world_m[0].tolist(),
        "cube_quat_wxyz": start.cube_quat_wxyz[0].tolist(),
        "noise_seed": None if seed is None else int(seed[0]),
        "motor_temperature_rise_k": None if rise_k is None else rise_k[0].tolist(),
    }
    truth.metadata(trial_log.PHYSICS_METADATA, record)
