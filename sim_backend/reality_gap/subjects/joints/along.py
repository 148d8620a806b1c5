"""Recorded episodes as equations of joints: recorded commands along the measured motion, restarted from what was measured."""

from collections.abc import Callable, Sequence

from sim_backend.reality_gap.knowledge.robot import Robot
from sim_backend.reality_gap.recording import JointSignals, Recording, RecordingError
from sim_backend.reality_gap.subjects.joints.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.plant import Plant
from sim_backend.reality_gap.subjects.joints.trajectory import trajectory


def along(
    plant: Plant, recordings: Sequence[Recording], robot: Robot, progress: Callable[[str, float], None]
) -> list[EpisodeEquations]:
    """The equations of each recording.

    Raises:
        RecordingError: an episode is too short.
    """
    found = []
    for index, recording in enumerate(recordings):
        progress(f"smoothing {recording.name}", 0.15 * index / len(recordings))
        found.append(equations_of(plant, recording, index, robot))
    return found


def equations_of(
    plant: Plant, recording: Recording, index: int, robot: Robot, *, reported: JointSignals | None = None
) -> EpisodeEquations:
    """One episode's; ``reported`` is what the robot's controller saw, where positions were corrected since."""
    path = trajectory(recording, cutoff_hz=robot.cutoff_hz)
    return EpisodeEquations(plant, path, index, robot=robot, reported=reported)


def names_of_joints(recordings: Sequence[Recording]) -> tuple[str, ...]:
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
                "or position targets and the controller that follows them"
            )
    return found.pop()
