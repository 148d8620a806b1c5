"""Records a trial as it happens: control periods in, log messages out, flushed at least every 250 ms of simulated time."""

from types import TracebackType

import numpy as np

from api_schemas import trial_log
from api_schemas.trial_log import TrialLogWriter
from sim_backend.driver.tracker import TrackedPose
from sim_backend.episode import Period
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger import viewer_scene

CUBE_EVERY_STEPS = 10
TRANSFORMS_EVERY_STEPS = 40


class Recorder:
    """Collects the periods of one trial (n = 1) and writes them in blocks; a context manager around the writer."""

    def __init__(self, writer: TrialLogWriter) -> None:
        self._writer = writer
        self._periods: list[Period] = []
        self._inference_ns: list[int] = []
        self._steps = 0
        self._tracked: TrackedPose | None = None

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.flush()

    def begin(self, task: Task, goal: Goal, tracked: TrackedPose) -> None:
        """Scene, goal and the pose that the tracker knew before the first step."""
        position, quat, tips = goal.cube_position_world_m[0], goal.cube_quat_wxyz[0], goal.fingertip_position_world_m[0]
        wanted = (position, quat, None) if task.moves_cube else (None, None, tips)
        self._writer.message(trial_log.MEASURED_SCENE, 0, viewer_scene.measured_scene(*wanted))
        if task.moves_cube:
            self._writer.goal(position, quat)
        else:
            self._writer.metadata(trial_log.GOAL_METADATA, {"fingertip_position_world_m": tips.tolist()})
        self._writer.message(trial_log.TRUE_SCENE, 0, viewer_scene.true_scene())
        self._writer.message(trial_log.MEASURED_TRANSFORMS, 0, viewer_scene.fixed_transforms())
        self._write_tracked(tracked)

    def record(self, period: Period, inference_time_ns: int) -> None:
        """One control period."""
        self._periods.append(period)
        self._inference_ns.append(inference_time_ns)
        self._steps += period.segment.joint_position_rad.shape[1]
        if self._steps + period.segment.joint_position_rad.shape[1] > trial_log.FLUSH_EVERY_STEPS:
            self.flush()

    def flush(self) -> None:
        """Write what was collected and hand it to the operating system."""
        if not self._periods:
            return
        segments = [period.segment for period in self._periods]
        first = segments[0].first_step
        joined = {
            name: np.concatenate([getattr(segment, name)[0] for segment in segments])
            for name in (
                "joint_position_rad",
                "joint_velocity_rad_s",
                "desired_torque_nm",
                "applied_torque_nm",
                "cube_position_world_m",
                "cube_quat_wxyz",
            )
        }
        self._writer.joint_states(
            first, joined["joint_position_rad"], joined["joint_velocity_rad_s"], joined["applied_torque_nm"]
        )
        self._writer.torque(first, joined["desired_torque_nm"], joined["applied_torque_nm"])
        self._write_cube(first, joined)
        for period, inference_time_ns in zip(self._periods, self._inference_ns, strict=True):
            self._writer.policy_step(period.segment.first_step, period.observation[0], period.action[0], inference_time_ns)
            for tracked in period.tracked:
                self._write_tracked(tracked)
        self._write_measured_transforms(first, joined["joint_position_rad"])
        self._periods, self._inference_ns, self._steps = [], [], 0
        self._writer.flush()

    def _write_cube(self, first: int, joined: dict[str, np.ndarray]) -> None:
        rows = _rows_at(first, len(joined["cube_quat_wxyz"]), CUBE_EVERY_STEPS)
        position, quat = joined["cube_position_world_m"][rows], joined["cube_quat_wxyz"][rows]
        self._writer.cube_pose(first + rows, position, quat)
        often = (first + rows) % TRANSFORMS_EVERY_STEPS == 0
        values = np.concatenate([position[often], quat[often]], axis=1)
        self._writer.transforms(trial_log.TRUE_TRANSFORMS, (first + rows)[often], values)

    def _write_measured_transforms(self, first: int, joint_position_rad: np.ndarray) -> None:
        assert self._tracked is not None, "begin the recording first"
        rows = _rows_at(first, len(joint_position_rad), TRANSFORMS_EVERY_STEPS)
        values = viewer_scene.measured_transforms(
            joint_position_rad[rows], self._tracked.cube_position_world_m, self._tracked.cube_quat_wxyz
        )
        self._writer.transforms(trial_log.MEASURED_TRANSFORMS, first + rows, values)

    def _write_tracked(self, tracked: TrackedPose) -> None:
        self._tracked = tracked
        self._writer.tracked_pose(
            tracked.capture_step,
            tracked.delivery_step,
            tracked.cube_position_world_m[0],
            tracked.cube_quat_wxyz[0],
            float(tracked.confidence[0]),
        )


def _rows_at(first_step: int, count: int, every: int) -> np.ndarray:
    """Rows of a block whose step is a multiple of ``every``."""
    return np.arange(-first_step % every, count, every)
