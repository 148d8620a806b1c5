"""What a robot's cameras see at the steps of the tracker's frames, for all who look: logs with images, and policies that see."""

from types import TracebackType

import numpy as np

from robot_farm.prepared import Prepared
from sim_backend.driver.driver import Segment
from sim_backend.effects.physics import Physics
from sim_backend.effects.tracking import frame_period_s
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape
from sim_backend.vision.cameras import Cameras


class Exposures:
    """Renders a robot's cameras in one trial; a context manager. Owner of the renderer, unless the tracker has one.

    ``works`` says which cameras are not dead, shape (3,).

    Raises:
        CamerasMissingError: the machine cannot render.
    """

    def __init__(self, ready: Prepared, shape: Shape) -> None:
        self._detector = ready.detector
        self._cameras = Cameras(ready.physics, shape=shape) if self._detector is None else None
        seed = ready.start.noise_seed
        self._seed = 0 if seed is None else int(seed[0])
        self._segment: Segment | None = None
        self._seen: list[tuple[int, np.ndarray]] = []
        self.set_physics(ready.physics)

    def __enter__(self) -> "Exposures":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._cameras is not None:
            self._cameras.close()

    def set_physics(self, physics: Physics) -> None:
        """A fault came or went: which cameras work, and how often they look. How images look stays as it was."""
        self.works = physics.value("dead_camera.dead")[0] == 0.0
        period_s = frame_period_s(physics.value("tracking_rate.rate_hz"))[0]
        self._period_steps = max(round(period_s / c.PHYSICS_STEP_S), 1)

    def of(self, segment: Segment) -> list[tuple[int, np.ndarray]]:
        """The exposures that fall into a segment: step, and images of shape (3, height, width, 3), uint8, of all cameras.

        Asked again for the same segment, nothing is rendered again.
        """
        if segment is not self._segment:
            first, count = segment.first_step, segment.cube_position_world_m.shape[1]
            rows = range(-first % self._period_steps, count, self._period_steps)
            self._seen = [(first + row, self.at(first + row, *_state(segment, row))) for row in rows]
            self._segment = segment
        return self._seen

    def at(self, step: int, joint_position_rad: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
        """The images of one state, shape (3, height, width, 3), uint8; where the tracker looks at images, those."""
        state, frame = (joint_position_rad, position_m, quat_wxyz), step // self._period_steps
        if self._detector is not None:
            return self._detector.images(*state, seed=self._seed, frame=frame)
        assert self._cameras is not None, "without a detector it has cameras of its own"
        return self._cameras.take(*state, seed=self._seed, frame=frame)


def _state(segment: Segment, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        segment.true_joint_position_rad[0, row],
        segment.cube_position_world_m[0, row],
        segment.cube_quat_wxyz[0, row],
    )
