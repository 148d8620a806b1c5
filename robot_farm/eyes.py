"""What a policy sees: the images of the newest frame whose report has arrived, as late and as often lost as poses."""

import numpy as np

from robot_farm.exposures import Exposures
from sim_backend.driver.driver import Measurement, Segment
from sim_backend.driver.tracker import TrackedPose

MOST_UNDER_WAY = 50
"""Frames that are remembered; those that are older were lost."""


class Eyes:
    """Delivers the images of one trial to its policy. Owner of those under way.

    Args:
        exposures: of the robot.
        edge_px: width and height of each view as the policy takes it; divides that of the camera's images.
    """

    def __init__(self, exposures: Exposures, edge_px: int) -> None:
        self._exposures, self._edge_px = exposures, edge_px
        self._under_way: dict[int, np.ndarray] = {}
        self._shown: tuple[int, np.ndarray] | None = None

    def begin(self, start: Measurement) -> None:
        """The scene at rest, which every frame before the first step shows."""
        state = start.true_joint_position_rad[0], start.cube_position_world_m[0], start.cube_quat_wxyz[0]
        self._under_way, self._shown = {}, (-1, self._view(self._exposures.at(-1, *state)))

    def take(self, segment: Segment) -> None:
        """Remember the exposures that fall into a segment."""
        for step, images in self._exposures.of(segment):
            self._under_way[step] = self._view(images)
        for step in sorted(self._under_way)[:-MOST_UNDER_WAY]:
            del self._under_way[step]

    def newest(self, tracked: TrackedPose) -> np.ndarray:
        """The images of the frame that the newest report is of, shape (3, edge, edge, 3), uint8; black where a camera is dead."""
        step = int(tracked.capture_step[0])
        if step in self._under_way:
            self._shown = step, self._under_way[step]
            self._under_way = {at: images for at, images in self._under_way.items() if at > step}
        assert self._shown is not None, "begin first"
        return self._shown[1]

    def _view(self, images: np.ndarray) -> np.ndarray:
        seen = smaller(images, self._edge_px)
        seen[~self._exposures.works] = 0
        return seen


def smaller(images: np.ndarray, edge_px: int) -> np.ndarray:
    """Images (k, size, size, 3), uint8, with edges of ``edge_px``, which divides their size; each pixel is the mean of a square.

    Always a copy.
    """
    views, size = images.shape[:2]
    factor = size // edge_px
    if factor == 1:
        return images.copy()
    parts = images.reshape(views, edge_px, factor, edge_px, factor, 3).astype(np.uint32).sum(axis=(2, 4))
    return ((parts + factor**2 // 2) // factor**2).astype(np.uint8)
