"""What the cameras saw in a trial, told from its log: images that it keeps, else the scene drawn from what was measured.

A log without images holds joint positions at 1 kHz and the tracker's poses. Drawn with the nominal calibration and the nominal
look they show what a user may know, and nothing of the robot's truth.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from sim_backend.replays.comparison import shape_of_log
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.pictures import from_jpeg, side_by_side, with_object
from trial_logs.images import read_images
from trial_logs.reader import LogUnreadableError, TrialLog, read_log

TURN_TOO_FAR_RAD = 0.6
"""Between two reports; farther apart the orientation jumped, and nothing between them was ever measured."""


@dataclass(frozen=True)
class Moment:
    """What was measured at a moment: joint positions (9,) in rad, and the tracked object, (3,) in m and (4,) wxyz."""

    at_s: float
    joint_position_rad: np.ndarray
    position_world_m: np.ndarray
    quat_wxyz: np.ndarray


def measured_at(log: TrialLog, at_s: float) -> Moment:
    """The joints at a moment, and where the tracker saw the object then: its reports count from when their images were taken.

    Raises:
        LogUnreadableError: the log holds no joint states or no report of the tracker.
    """
    if not len(log.joint_steps) or not len(log.capture_s):
        raise LogUnreadableError("the log holds nothing to draw: it needs joint states and reports of the tracker")
    row = int(np.clip(np.searchsorted(log.joint_steps, at_s / c.PHYSICS_STEP_S), 0, len(log.joint_steps) - 1))
    position, quat = _tracked_at(log, at_s)
    return Moment(at_s, log.joint_position_rad[row], position, quat)


def _tracked_at(log: TrialLog, at_s: float) -> tuple[np.ndarray, np.ndarray]:
    after = int(np.clip(np.searchsorted(log.capture_s, at_s), 0, len(log.capture_s) - 1))
    before = max(after - 1, 0)
    first, second = log.capture_s[before], log.capture_s[after]
    share = float(np.clip((at_s - first) / (second - first), 0.0, 1.0)) if second > first else 1.0
    one, other = log.tracked_quat_wxyz[before], log.tracked_quat_wxyz[after]
    other = other if one @ other >= 0.0 else -other
    if 2 * np.arccos(min(1.0, float(one @ other))) > TURN_TOO_FAR_RAD:
        share = round(share)
    quat = (1 - share) * one + share * other
    position = (1 - share) * log.tracked_position_world_m[before] + share * log.tracked_position_world_m[after]
    return position, quat / np.linalg.norm(quat)


class Views:
    """The views of one log; a context manager.

    Args:
        path: of the log.
        drawn: draw the scene even where the log keeps images.
        edges: draw the edges of the tracked object into the images, as the nominal calibration puts them.

    Raises:
        LogUnreadableError: it is no log of a trial.
    """

    def __init__(self, path: Path, *, drawn: bool = False, edges: bool = False) -> None:
        self.log = read_log(path)
        self._shape: Shape = shape_of_log(self.log)
        self._edges = edges
        self._kept: dict[int, dict[int, bytes]] = {}
        for image in () if drawn else read_images(path):
            self._kept.setdefault(image.step, {})[image.camera] = image.jpeg
        self._steps = np.array(sorted(self._kept), dtype=int)
        self._cameras: Cameras | None = None

    def __enter__(self) -> "Views":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._cameras is not None:
            self._cameras.close()

    @property
    def duration_s(self) -> float:
        """Of the trial."""
        return len(self.log.joint_steps) * c.PHYSICS_STEP_S

    @property
    def keeps_images(self) -> bool:
        """Whether the views are images that the log keeps."""
        return bool(self._kept)

    def at(self, at_s: float) -> tuple[np.ndarray, float]:
        """The three views at a moment.

        Args:
            at_s: since the trial's start.

        Returns:
            One image, shape (270, 810, 3), uint8, and when it was exposed, s: kept images are the last before the moment.

        Raises:
            ValueError: the moment is outside of the trial.
        """
        if not 0.0 <= at_s <= self.duration_s:
            raise ValueError(f"{at_s:g} s is outside of the trial; it lasts from 0 to {self.duration_s:g} s")
        images, exposed_s = self._kept_at(at_s) if self._kept else self._drawn_at(at_s)
        if self._edges:
            images = self._with_edges(images, measured_at(self.log, exposed_s))
        return side_by_side(images), exposed_s

    def frames(self, rate_hz: float) -> Iterator[np.ndarray]:
        """The views at a steady rate from the trial's start to its end, shape (270, 810, 3) each."""
        for number in range(max(int(self.duration_s * rate_hz), 1)):
            yield self.at(number / rate_hz)[0]

    def _kept_at(self, at_s: float) -> tuple[list[np.ndarray], float]:
        place = max(int(np.searchsorted(self._steps, round(at_s / c.PHYSICS_STEP_S), side="right")) - 1, 0)
        step = int(self._steps[place])
        black = np.zeros((c.CAMERA_IMAGE_PX, c.CAMERA_IMAGE_PX, 3), np.uint8)
        seen = self._kept[step]
        return [from_jpeg(seen[k]) if k in seen else black for k in range(len(c.CAMERAS))], step * c.PHYSICS_STEP_S

    def _drawn_at(self, at_s: float) -> tuple[list[np.ndarray], float]:
        if self._cameras is None:
            self._cameras = Cameras(shape=self._shape)
        moment = measured_at(self.log, at_s)
        return list(self._cameras.take(moment.joint_position_rad, moment.position_world_m, moment.quat_wxyz)), at_s

    def _with_edges(self, images: list[np.ndarray], moment: Moment) -> list[np.ndarray]:
        turn = rotation_of(moment.quat_wxyz)
        pairs = zip(images, nominal_calibrations(), strict=True)
        return [with_object(image, camera, moment.position_world_m, turn, self._shape) for image, camera in pairs]


def rotation_of(quat_wxyz: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a unit quaternion (4,) wxyz."""
    w, x, y, z = quat_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
