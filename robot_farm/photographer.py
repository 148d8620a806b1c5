"""Takes the images that a job asked for: the same instants as the tracker's frames, as the robot's own cameras see them."""

from dataclasses import dataclass
from types import TracebackType

import numpy as np

from robot_farm.prepared import Prepared
from sim_backend.driver.driver import Segment
from sim_backend.effects.physics import Physics
from sim_backend.effects.tracking import frame_period_s
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.messages import calibration_message, camera_transforms
from sim_backend.vision.pictures import as_jpeg
from trial_logs import trial_log
from trial_logs.trial_log import TrialLogWriter


@dataclass(frozen=True)
class Picture:
    """One camera's image of one exposure as a JPEG file."""

    camera: int
    step: int
    jpeg: bytes


class Photographer:
    """Renders a robot's cameras in one trial; a context manager. Owner of the renderer, unless the tracker has one.

    Exposures come at the steps of the tracker's frames. A camera that is dead gives none.

    Raises:
        CamerasMissingError: the machine cannot render.
    """

    def __init__(self, ready: Prepared, shape: Shape) -> None:
        self._detector = ready.detector
        self._cameras = Cameras(ready.physics, shape=shape) if self._detector is None else None
        seed = ready.start.noise_seed
        self._seed = 0 if seed is None else int(seed[0])
        self.set_physics(ready.physics)

    def __enter__(self) -> "Photographer":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._cameras is not None:
            self._cameras.close()

    def set_physics(self, physics: Physics) -> None:
        """A fault came or went: which cameras work, and how often they look. How images look stays as it was."""
        self._works = physics.value("dead_camera.dead")[0] == 0.0
        period_s = frame_period_s(physics.value("tracking_rate.rate_hz"))[0]
        self._period_steps = max(round(period_s / c.PHYSICS_STEP_S), 1)

    def begin(self, writer: TrialLogWriter) -> None:
        """What every log with images begins with: the cameras as their files have them, never as they truly stand."""
        nominal = nominal_calibrations()
        for topic, calibration in zip(trial_log.CALIBRATIONS, nominal, strict=True):
            writer.message(topic, 0, calibration_message(calibration))
        writer.message(trial_log.MEASURED_TRANSFORMS, 0, camera_transforms(nominal))

    def take(self, segment: Segment) -> list[Picture]:
        """The images whose exposure falls into a segment."""
        first, count = segment.first_step, segment.cube_position_world_m.shape[1]
        pictures = []
        for row in range(-first % self._period_steps, count, self._period_steps):
            frame = (first + row) // self._period_steps
            images = self._images(*_state(segment, row), frame)
            pictures += [Picture(k, first + row, as_jpeg(images[k])) for k in np.flatnonzero(self._works).tolist()]
        return pictures

    def _images(self, joints: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray, frame: int) -> np.ndarray:
        """Those that the tracker looked at, where it looks at any."""
        if self._detector is not None:
            return self._detector.images(joints, position_m, quat_wxyz, seed=self._seed, frame=frame)
        assert self._cameras is not None, "without a detector it has cameras of its own"
        return self._cameras.take(joints, position_m, quat_wxyz, seed=self._seed, frame=frame)


def _state(segment: Segment, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        segment.true_joint_position_rad[0, row],
        segment.cube_position_world_m[0, row],
        segment.cube_quat_wxyz[0, row],
    )
