"""What a robot with cameras has in the formula's place: it renders each frame, and a tracker on images looks for the cube in it.

When frames are taken, lost and delivered is as before: those effects are of the cameras' process, not of what it finds. A dead
camera gives no image. What the formula adds to the pose (jumps, offsets, noise) is left out; images have errors of their own.
"""

import numpy as np

from sim_backend.driver import detection
from sim_backend.driver.detection import Detected, Values
from sim_backend.effects import tracking
from sim_backend.trifinger.objects import CUBE, Kind, Shape
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_tracker import ImageTracker


def tracked_by_images(shape: Shape) -> bool:
    """Whether the tracker on images knows an object: cubes of any size, by their six colours."""
    return shape.kind is Kind.BOX and len(set(shape.size_m)) == 1


class ImageDetector:
    """Detects the object of one robot (n = 1) in its cameras' images; a ``Detector`` of the driver. Owner of the cameras.

    Args:
        cameras: of the robot, with its effects on images.
        shape: the object in the arena.
    """

    def __init__(self, cameras: Cameras, shape: Shape = CUBE) -> None:
        self._cameras, self._tracker = cameras, ImageTracker(nominal_calibrations(), shape.size_m)
        self._last_frame = 0
        self._kept: tuple[np.ndarray, np.ndarray] | None = None

    def close(self) -> None:
        """Give the renderer back."""
        self._cameras.close()

    def __call__(
        self,
        values: Values,
        seed: np.ndarray,
        frame: np.ndarray,
        joint_position_rad: np.ndarray,
        position_m: np.ndarray,
        quat_wxyz: np.ndarray,
    ) -> Detected:
        """As ``detection.detect``, whose delays and losses these are."""
        *_, delay_s, lost = detection.detect(values, seed, frame, joint_position_rad, position_m, quat_wxyz)
        number = int(frame[0])
        if number <= self._last_frame:
            self._tracker.forget()
        self._last_frame = number
        working = np.flatnonzero(tracking.working(values.dead)[0])
        images = self.images(joint_position_rad[0], position_m[0], quat_wxyz[0], seed=int(seed[0]), frame=number)
        found = self._tracker.track(images[working], working.tolist())
        confidence = np.array([found.confidence])
        return found.visible_faces[None], confidence, found.position_world_m[None], found.quat_wxyz[None], delay_s, lost

    def images(
        self, joint_position_rad: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray, *, seed: int, frame: int
    ) -> np.ndarray:
        """The images of a frame, shape (3, height, width, 3), uint8; asked for again, the last ones are not rendered again."""
        state = np.concatenate([joint_position_rad, position_m, quat_wxyz, [seed, frame]])
        if self._kept is None or not np.array_equal(self._kept[0], state):
            taken = self._cameras.take(joint_position_rad, position_m, quat_wxyz, seed=seed, frame=frame)
            self._kept = (state, taken)
        return self._kept[1]
