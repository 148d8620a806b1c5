"""Calibrations and places of the cameras as Foxglove's messages, so that a viewer lays the scene over an image."""

from collections.abc import Sequence

import mujoco
import numpy as np
from foxglove import messages as fm

from sim_backend.vision.calibration import Calibration

DISTORTION_MODEL = "plumb_bob"


def calibration_message(calibration: Calibration) -> bytes:
    """An encoded ``foxglove.CameraCalibration``."""
    matrix = calibration.matrix
    return fm.CameraCalibration(
        timestamp=fm.Timestamp(sec=0, nsec=0),
        frame_id=calibration.name,
        width=calibration.size_px[0],
        height=calibration.size_px[1],
        distortion_model=DISTORTION_MODEL,
        D=calibration.distortion.tolist(),
        K=matrix.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.hstack([matrix, np.zeros((3, 1))]).ravel().tolist(),
    ).encode()


def camera_transforms(calibrations: Sequence[Calibration], world: str = "world") -> bytes:
    """An encoded ``foxglove.FrameTransforms`` of the cameras in the world: x to the right, y down, z forward."""
    transforms = []
    for calibration in calibrations:
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(calibration.rotation.T).ravel())
        w, x, y, z = (float(value) for value in quat)
        place = [float(value) for value in calibration.position_world_m]
        transforms.append(
            fm.FrameTransform(
                timestamp=fm.Timestamp(sec=0, nsec=0),
                parent_frame_id=world,
                child_frame_id=calibration.name,
                translation=fm.Vector3(x=place[0], y=place[1], z=place[2]),
                rotation=fm.Quaternion(w=w, x=x, y=y, z=z),
            )
        )
    return fm.FrameTransforms(transforms=transforms).encode()
