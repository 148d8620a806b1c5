"""What finds the object for one robot: the formula, or a tracker on the images that its cameras would take."""

import ctypes
import functools
import importlib.util
from typing import TYPE_CHECKING

from api_schemas.robot import Lease
from api_schemas.tracker import TrackerName
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE, Shape

if TYPE_CHECKING:
    from sim_backend.vision.image_detector import ImageDetector

_PACKAGES, _LIBRARY = ("cv2", "OpenGL"), "libEGL.so.1"


@functools.cache
def blind() -> str | None:
    """What this machine lacks to render, as a sentence; None where nothing is missing. Loads no renderer."""
    lacks = [name for name in _PACKAGES if importlib.util.find_spec(name) is None]
    try:
        ctypes.CDLL(_LIBRARY)
    except OSError:
        lacks.append(_LIBRARY)
    if not lacks:
        return None
    return (
        f"this robot has no cameras: {', '.join(lacks)} missing; install the extra 'vision' "
        "(apt-get install libegl1 libgl1-mesa-dri renders in software)"
    )


def blind_to(lease: Lease) -> str | None:
    """Why this robot cannot run a lease whose policy sees; None for all that it can."""
    return None if lease.manifest is None or lease.manifest.images is None else blind()


class Sight:
    """Makes the tracker of each trial. Owner of the renderer, which is made in the process that uses it.

    ``detector`` looks at images in the trial that is prepared; it is None where the formula reports, as it does of objects
    that the tracker on images does not know.
    """

    def __init__(self, wanted: TrackerName = TrackerName.POSE) -> None:
        self._wanted = wanted
        self.detector: ImageDetector | None = None

    def tracker(self, physics: Physics | None = None, shape: Shape = CUBE) -> Tracker:
        """A tracker that has seen nothing.

        Raises:
            CamerasMissingError: it needs images, and this machine cannot render.
        """
        self.close()
        if self._wanted is TrackerName.IMAGES:
            from sim_backend.vision.cameras import Cameras
            from sim_backend.vision.image_detector import ImageDetector, tracked_by_images

            if tracked_by_images(shape):
                self.detector = ImageDetector(Cameras(physics, shape=shape), shape)
                return Tracker(physics=physics, shape=shape, detector=self.detector)
        return Tracker(physics=physics, shape=shape)

    def close(self) -> None:
        """Give the renderer back."""
        if self.detector is not None:
            self.detector.close()
            self.detector = None
