"""Records a trial as it happens: control periods in, log messages out, flushed at least every 250 ms while it goes on."""

import time
from collections.abc import Callable
from itertools import compress
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from robot_farm.faults import CAMERA_NAMES
from sim_backend.driver.driver import Command, Segment
from sim_backend.driver.tracker import TrackedPose
from sim_backend.episode import Period
from sim_backend.evidence import Witness
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import constants as c
from sim_backend.trifinger import viewer_scene
from sim_backend.trifinger.objects import CUBE, Shape
from trial_logs import trial_log
from trial_logs.trial_log import TrialLogWriter

if TYPE_CHECKING:
    from robot_farm.photographer import Photographer, Picture

TRUTH_EVERY_STEPS = 10
"""Steps from one true state to the next; whoever needs every millisecond has it simulated again."""
TRANSFORMS_EVERY_STEPS = 40
MOTORS_EVERY_STEPS = 250
_POSE = ("cube_position_world_m", "cube_quat_wxyz")
_FACES = tuple(c.CUBE_FACE_COLOURS)


class Recorder:
    """Collects what happens in one trial (n = 1) and writes it in blocks; a context manager around the writers.

    Args:
        writer: of the log.
        truth: of the truth file; None where the truth goes into the log, too.
        shape: the object in the arena.
        photographer: takes the images, where the job asked for them.
        clock: seconds, by which blocks are flushed that no simulated second fills.
    """

    def __init__(
        self,
        writer: TrialLogWriter,
        truth: TrialLogWriter | None = None,
        shape: Shape = CUBE,
        photographer: "Photographer | None" = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._writer, self._truth, self._shape, self._photographer = writer, truth, shape, photographer
        self._pictures: list[Picture] = []
        self._segments: list[Segment] = []
        self._asked: list[tuple[int, np.ndarray, np.ndarray, int]] = []
        self._reports: list[TrackedPose] = []
        self._steps, self._clock, self._flushed_s = 0, clock, clock()
        self._tracked: TrackedPose | None = None
        self._temperatures: list[tuple[int, np.ndarray]] = []
        self.witness = Witness()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.flush()

    def begin(self, task: Task | None, goal: Goal, tracked: TrackedPose) -> None:
        """Scene, goal (None of a task) and the pose that the tracker knew before the first step."""
        position, quat, tips = goal.cube_position_world_m[0], goal.cube_quat_wxyz[0], goal.fingertip_position_world_m[0]
        wanted = (None, None, None)
        if task is not None:
            wanted = (position, quat, None) if task.moves_cube else (None, None, tips)
        self._writer.message(trial_log.MEASURED_SCENE, 0, viewer_scene.measured_scene(*wanted, shape=self._shape))
        if task is not None and task.moves_cube:
            self._writer.goal(position, quat)
        elif task is not None:
            self._writer.metadata(trial_log.GOAL_METADATA, {"fingertip_position_world_m": tips.tolist()})
        (self._truth or self._writer).message(trial_log.TRUE_SCENE, 0, viewer_scene.true_scene(self._shape))
        self._writer.message(trial_log.MEASURED_TRANSFORMS, 0, viewer_scene.fixed_transforms())
        if self._photographer is not None:
            self._photographer.begin(self._writer)
        self._write_tracked(tracked)

    def record(self, period: Period, inference_time_ns: int, temperature_rise_k: np.ndarray | None = None) -> None:
        """One control period of a policy, and the temperature of the motors after it, shape (9,), K."""
        self._make_room(period.segment)
        self._asked.append((period.segment.first_step, period.observation[0], period.action[0], inference_time_ns))
        self._add(period.segment, period.tracked, temperature_rise_k)

    def record_command(
        self, command: Command, segment: Segment, tracked: list[TrackedPose], temperature_rise_k: np.ndarray | None = None
    ) -> None:
        """One command of an excitation and what followed."""
        self._make_room(segment)
        target = None if command.position_target_rad is None else command.position_target_rad[0]
        self._writer.command(segment.first_step, command.desired_torque_nm[0], target)
        self._add(segment, tracked, temperature_rise_k)

    def flush(self) -> None:
        """Write what was collected and hand it to the operating system."""
        if not self._segments:
            return
        first = self._segments[0].first_step
        if self._asked:
            self._writer.policy_steps(*map(np.array, zip(*self._asked, strict=True)))
        position_rad = self._joined("joint_position_rad")
        self._write_measured(first, position_rad)
        self._write_measured_transforms(first, position_rad)
        for tracked in self._reports:
            self._write_tracked(tracked)
        for picture in self._pictures:
            self._writer.image(picture.camera, picture.step, picture.jpeg)
        self._write_cube(first)
        if self._truth is not None:
            self._write_truth(self._truth, first)
        self._segments, self._asked, self._reports, self._pictures, self._temperatures, self._steps = [], [], [], [], [], 0
        self._writer.flush()
        self._flushed_s = self._clock()

    def _make_room(self, segment: Segment) -> None:
        is_full = self._steps + segment.joint_position_rad.shape[1] > trial_log.FLUSH_EVERY_STEPS
        if is_full or self._clock() - self._flushed_s >= trial_log.FLUSH_EVERY_S:
            self.flush()

    def _add(self, segment: Segment, tracked: list[TrackedPose], temperature_rise_k: np.ndarray | None) -> None:
        self._segments.append(segment)
        if self._photographer is not None:
            self._pictures += self._photographer.take(segment)
        self._reports += tracked
        steps = segment.joint_position_rad.shape[1]
        self._steps += steps
        end = segment.first_step + steps
        if temperature_rise_k is not None and end // MOTORS_EVERY_STEPS > segment.first_step // MOTORS_EVERY_STEPS:
            self._temperatures.append((end, temperature_rise_k))

    def _joined(self, name: str) -> np.ndarray:
        """A field of all segments that were collected, without the robots' axis."""
        return np.concatenate([getattr(segment, name) for segment in self._segments], axis=1)[0]

    def _write_measured(self, first: int, position_rad: np.ndarray) -> None:
        names = ("joint_velocity_rad_s", "measured_torque_nm", "applied_torque_nm")
        velocity_rad_s, torque_nm, applied_nm = (self._joined(name) for name in names)
        self._writer.joint_states(first, position_rad, velocity_rad_s, torque_nm)
        self._writer.torque(first, self._joined("desired_torque_nm"), applied_nm)
        self.witness.take(first, position_rad, velocity_rad_s, applied_nm)

    def _write_truth(self, truth: TrialLogWriter, first: int) -> None:
        rows = _rows_at(first, self._steps, TRUTH_EVERY_STEPS)
        names = ("true_joint_position_rad", "true_joint_velocity_rad_s", "effective_torque_nm")
        truth.true_joint_states(first + rows, *(self._joined(name)[rows] for name in names))
        for step, temperature_rise_k in self._temperatures:
            truth.motors(step, temperature_rise_k)
        truth.flush()

    def _write_cube(self, first: int) -> None:
        rows = _rows_at(first, self._steps, TRUTH_EVERY_STEPS)
        position, quat = (self._joined(name)[rows] for name in _POSE)
        writer = self._truth or self._writer
        writer.cube_pose(first + rows, position, quat)
        often = (first + rows) % TRANSFORMS_EVERY_STEPS == 0
        values = np.concatenate([position[often], quat[often]], axis=1)
        writer.transforms(trial_log.TRUE_TRANSFORMS, (first + rows)[often], values)

    def _write_measured_transforms(self, first: int, joint_position_rad: np.ndarray) -> None:
        """With the object where the last report that had come had it."""
        assert self._tracked is not None, "begin the recording first"
        known = [self._tracked, *self._reports]
        rows = _rows_at(first, len(joint_position_rad), TRANSFORMS_EVERY_STEPS)
        last = np.searchsorted([int(tracked.delivery_step[0]) for tracked in self._reports], first + rows, side="right")
        position_m, quat_wxyz = (np.concatenate([getattr(tracked, name) for tracked in known])[last] for name in _POSE)
        values = viewer_scene.measured_transforms(joint_position_rad[rows], position_m, quat_wxyz)
        self._writer.transforms(trial_log.MEASURED_TRANSFORMS, first + rows, values)

    def _write_tracked(self, tracked: TrackedPose) -> None:
        self._tracked = tracked
        self.witness.take_report(tracked)
        seen = zip(CAMERA_NAMES, tracked.visible_faces[0].tolist(), strict=True)
        faces = {name: list(compress(_FACES, is_seen)) for name, is_seen in seen}
        self._writer.tracked_pose(
            int(tracked.capture_step[0]),
            int(tracked.delivery_step[0]),
            tracked.cube_position_world_m[0],
            tracked.cube_quat_wxyz[0],
            float(tracked.confidence[0]),
            raw_confidence=float(tracked.raw_confidence[0]),
            raw_position_world_m=tracked.raw_position_world_m[0].tolist(),
            raw_quat_wxyz=tracked.raw_quat_wxyz[0].tolist(),
            visible_faces=faces,
        )


def _rows_at(first_step: int, count: int, every: int) -> np.ndarray:
    """Rows of a block whose step is a multiple of ``every``."""
    return np.arange(-first_step % every, count, every)
