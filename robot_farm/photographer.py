"""Makes pictures for the log where a job asked for images: the same instants as the tracker's frames, as the robot sees them."""

from dataclasses import dataclass

import numpy as np

from robot_farm.exposures import Exposures
from sim_backend.driver.driver import Segment
from sim_backend.vision.calibration import nominal_calibrations
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
    """Makes pictures of a trial's exposures. A camera that is dead gives none."""

    def __init__(self, exposures: Exposures) -> None:
        self._exposures = exposures

    def begin(self, writer: TrialLogWriter) -> None:
        """What every log with images begins with: the cameras as their files have them, never as they truly stand."""
        nominal = nominal_calibrations()
        for topic, calibration in zip(trial_log.CALIBRATIONS, nominal, strict=True):
            writer.message(topic, 0, calibration_message(calibration))
        writer.message(trial_log.MEASURED_TRANSFORMS, 0, camera_transforms(nominal))

    def take(self, segment: Segment) -> list[Picture]:
        """The pictures whose exposure falls into a segment."""
        working = np.flatnonzero(self._exposures.works).tolist()
        return [Picture(k, step, as_jpeg(images[k])) for step, images in self._exposures.of(segment) for k in working]
