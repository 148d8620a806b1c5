"""What finds the object for one robot: the formula, or a tracker on the images that its cameras would take."""

from typing import TYPE_CHECKING

from api_schemas.tracker import TrackerName
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE, Shape

if TYPE_CHECKING:
    from sim_backend.vision.image_detector import ImageDetector


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
